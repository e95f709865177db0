"""What is to be known of the word at a position, as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable

from serp.language_server.index import FLUENTS, Index, NameKind, Occurrence, Use
from serp.language_server.keywords import MEANINGS
from serp.pddl.comments import comment_of
from serp.pddl.source import Place, Source

_WORD = re.compile(r"[^\s();]+")
_MOST = 12
"""Places of one kind that are listed."""


def explained(index: Index, source: Source, position: int) -> tuple[str, Place] | None:
    """Return what is known of a word, and its place; None where nothing is.

    A fluent comes with the expert's comment, its value in the problem's `:init`, and the actions,
    processes and events that change and read it, with their lines.
    """
    place = _word_at(source, position)
    if place is None:
        return None
    occurrence = index.at(source, position)
    word = place.text.lower()
    texts: list[str] = []
    if occurrence is not None and occurrence.kind in FLUENTS:
        texts += _fluent(index, occurrence)
    elif occurrence is not None:
        texts += _other(index, occurrence)
    if word in MEANINGS and (occurrence is None or word in ("reward", "unsafe", "terminal")):
        texts.append(MEANINGS[word])
    return ("\n\n".join(texts), place) if texts else None


def _word_at(source: Source, position: int) -> Place | None:
    line = source.place(position, position).line
    start = source.line_starts[line - 1]
    code = source.line_text(line).partition(";")[0]
    for match in _WORD.finditer(code):
        if start + match.start() <= position <= start + match.end():
            return source.place(start + match.start(), start + match.end())
    return None


def _fluent(index: Index, occurrence: Occurrence) -> list[str]:
    declaration = index.declaration(occurrence)
    form = declaration.form if declaration is not None else occurrence.form
    texts = [f"```pddl\n{form.text}\n```"]
    comment = comment_of(form)
    same = index.same(occurrence)
    initial = [o.form.text for o in same if o.use is Use.INITIAL]
    texts += [comment] if comment else []
    if initial:
        texts.append(f"At the start: {_listed(f'`{text}`' for text in initial)}")
    changed = _sections([o for o in same if o.use is Use.CHANGED])
    read = _sections([o for o in same if o.use is Use.READ])
    texts.append(f"Changed by {changed or 'nothing'}  \nRead by {read or 'nothing'}")
    return texts


def _sections(occurrences: Iterable[Occurrence]) -> str:
    """Return in what sections a name occurs, and in which lines."""
    lines: dict[str, list[int]] = {}
    for occurrence in occurrences:
        kind, _, name = occurrence.inside.text.lstrip("(:").partition(" ")
        named = f"{kind} `{name}`" if name and not name.startswith("(") else f"`:{kind}`"
        lines.setdefault(named, []).append(occurrence.place.line)
    return _listed(
        f"{named} (line{'s' if len(set(at)) > 1 else ''} {', '.join(map(str, sorted(set(at))))})"
        for named, at in lines.items()
    )


def _listed(texts: Iterable[str]) -> str:
    found = list(dict.fromkeys(texts))
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return ", ".join(found[:_MOST]) + more


def _other(index: Index, occurrence: Occurrence) -> list[str]:
    declaration = index.declaration(occurrence)
    if declaration is None:
        return []
    of_type = f" of type `{declaration.type}`" if declaration.type else ""
    texts = [f"{occurrence.kind.value} `{occurrence.name}`{of_type}"]
    is_schema = occurrence.kind in (NameKind.ACTION, NameKind.PROCESS, NameKind.EVENT)
    comment = comment_of(declaration.inside if is_schema else declaration.place)
    if comment and occurrence.kind is not NameKind.VARIABLE:
        texts.append(comment)
    return texts
