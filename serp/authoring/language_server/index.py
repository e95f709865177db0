"""The names of a domain and its problem: where they are declared, and where they are used.

The index is made of the lists and words of the files, so that it has everything that can be read
of a file that is being written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from serp.pddl.parser import SCHEMA_SECTIONS
from serp.pddl.reader import Group, Node, Word, read_what_can_be
from serp.pddl.scope import is_name
from serp.pddl.source import Place, Source, line_start

FLUENTS = ("predicate", "function")


class DeclaredName(NamedTuple):
    """Where a name, in lower case, is declared.

    `kind` is `predicate`, `function`, `type`, `object`, `action`, `process`, `event` or `variable`;
    `place` the word; `form` the form that it begins or names, else the word itself.
    """

    name: str
    kind: str
    place: Place
    form: Place


class Index:
    """The names in files that belong together."""

    def __init__(self, *sources: Source) -> None:
        self.sources = sources
        self._sections = [section for source in sources for section in read_what_can_be(source)]
        self.declared = [name for section in self._sections for name in _declared(section)]

    def declaration(self, word: Place) -> DeclaredName | None:
        """Return where what a word names is declared; None where it is not."""
        name, source = word.text.lower(), word.source
        if name.startswith("?"):  # where it first is in its section
            for section in self._sections:
                place = section.place
                if place.source.name == source.name and place.start <= word.start < place.end:
                    first = next((w.place for w in _words(section) if w.text == name), None)
                    if first is not None:
                        return DeclaredName(name, "variable", first, first)
        same = [declared for declared in self.declared if declared.name == name]
        opens = source.text[: word.start].endswith("(")
        fitting = (declared for declared in same if (declared.kind in FLUENTS) == opens)
        return next(fitting, next(iter(same), None))

    def uses(self, fluent: str) -> Iterator[tuple[str, list[int]]]:
        """Yield each section that names a fluent, such as `action go`, and the lines there."""
        for section in self._sections:
            lines = [word.place.line for word in _words(section) if word.text == fluent]
            if lines and section.head not in (":predicates", ":functions"):
                schema = section.head in SCHEMA_SECTIONS
                title = section.place.opening.text.lstrip("(:") if schema else section.head
                yield title, list(dict.fromkeys(lines))


def typed_before(text: str) -> str:
    """Return the word that a text ends with; it may be empty."""
    return re.split(r"[\s();]", text)[-1]


def word_at(source: Source, position: int) -> Place | None:
    """Return the word at a position of a file, or right before it; None in a comment."""
    line = source.text[line_start(source.text, position) : position]
    start = position - len(typed_before(line))
    end = position + len(re.split(r"[\s();]", source.text[position:], maxsplit=1)[0])
    return source.place(start, end) if start < end and ";" not in line else None


def _declared(section: Group) -> Iterator[DeclaredName]:
    items = section.items[1:]
    match section.head:
        case ":types" | ":constants" | ":objects" as head:
            kind = "type" if head == ":types" else "object"
            for word in _without_types(items):
                yield DeclaredName(word.text, kind, word.place, word.place)
        case ":predicates" | ":functions" as head:
            for item in items:
                first = item.items[0] if isinstance(item, Group) and item.items else None
                if isinstance(first, Word) and is_name(first):
                    yield DeclaredName(first.text, head[1:-1], first.place, item.place)
        case head if head in SCHEMA_SECTIONS and items and isinstance(items[0], Word):
            yield DeclaredName(items[0].text, head[1:], items[0].place, section.place.opening)


def _without_types(items: Sequence[Node]) -> Iterator[Word]:
    """Yield the names in a typed list, such as `a` and `b` in `a b - t`."""
    before = ""
    for item in items:
        text = item.text if isinstance(item, Word) else ""
        if isinstance(item, Word) and "-" not in (text, before):
            yield item
        before = text


def _words(node: Node) -> Iterator[Word]:
    if isinstance(node, Word):
        yield node
        return
    for item in node.items:
        yield from _words(item)
