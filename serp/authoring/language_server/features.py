"""Positions, diagnostics, quick fixes and renaming, as the Language Server Protocol has them."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator

from lsprotocol import types
from pygls.workspace import PositionCodec

from serp.authoring.language_server.index import Index, NameKind
from serp.authoring.lint.findings import Finding, Severity
from serp.errors import SerpError
from serp.pddl import syntax as x
from serp.pddl.scope import RESERVED_WORDS
from serp.pddl.source import Edit, Place, Source, line_end


class Positions:
    """Converts between characters of a text and positions as the editor counts them."""

    def __init__(self, codec: PositionCodec | None = None) -> None:
        self._codec = codec or PositionCodec()

    def position(self, source: Source, offset: int) -> types.Position:
        """Return the position of a character."""
        place = Place(source, offset, offset)
        at = types.Position(place.line - 1, place.column - 1)
        return self._codec.position_to_client_units(_lines(source), at)

    def offset(self, source: Source, position: types.Position) -> int:
        """Return the character at a position; the nearest one where there is none."""
        at = self._codec.position_from_client_units(_lines(source), position)
        return min(source.line_starts[at.line] + at.character, len(source.text))

    def range(self, place: Place) -> types.Range:
        """Return where a place is."""
        return types.Range(
            self.position(place.source, place.start), self.position(place.source, place.end)
        )

    def first_line(self, place: Place) -> types.Range:
        """Return where a place is, to the end of its first line."""
        source = place.source
        end = source.line_starts[place.line - 1] + len(place.source_line)
        return self.range(source.place(place.start, min(place.end, max(end, place.start))))


@functools.lru_cache(maxsize=4)
def _lines(source: Source) -> list[str]:
    return [f"{source.line_text(n)}\n" for n in range(1, len(source.line_starts) + 1)]


_NAME = re.compile(r"[a-z][a-z0-9_\-]*\Z", re.IGNORECASE | re.ASCII)
_FIXED = (x.REWARD, x.UNSAFE, x.TERMINAL, x.OBJECT)


def renamed(index: Index, source: Source, position: int, name: str) -> list[Place]:
    """Return all places of a name that is to be another one.

    Raises:
        SerpError: There is nothing to rename, or the new name is none, or is taken.
    """
    here = index.at(source, position)
    if here is None or here.name in _FIXED or index.declaration(here) is None:
        raise SerpError("nothing that the files declare stands here")
    variable = here.kind is NameKind.VARIABLE
    plain = name.removeprefix("?") if variable else name
    if variable != name.startswith("?") or not _NAME.match(plain):
        wanted = "`?` and a name" if variable else "a letter, then letters, digits, `-` and `_`"
        raise SerpError(f"`{name}` cannot be a name here: expected {wanted}")
    if plain.lower() in (*RESERVED_WORDS, *_FIXED):
        raise SerpError(f"`{name}` is a word of PDDL, or reserved")
    same_scope = [o for o in index.occurrences if not variable or o.inside == here.inside]
    if name.lower() != here.name and any(o.name == name.lower() for o in same_scope):
        raise SerpError(f"`{name}` is taken")
    return [occurrence.place for occurrence in index.same(here)]


_START = types.Range(types.Position(0, 0), types.Position(0, 0))
_SEVERITIES: dict[Severity, types.DiagnosticSeverity] = {
    "error": types.DiagnosticSeverity.Error,
    "warning": types.DiagnosticSeverity.Warning,
    "note": types.DiagnosticSeverity.Information,
}


def diagnostic(finding: Finding, positions: Positions) -> types.Diagnostic:
    """Return a finding; of a long place, its first line."""
    text = finding.message + (f"\n{finding.advice}" if finding.advice else "")
    return types.Diagnostic(
        positions.first_line(finding.place) if finding.place is not None else _START,
        text,
        severity=_SEVERITIES[finding.severity],
        code=finding.code,
        source="serp",
    )


def code_actions(
    findings: Iterable[Finding], uri: str, selected: types.Range, positions: Positions
) -> list[types.CodeAction]:
    """Return what can be done about the findings in a range."""
    return [
        action
        for finding in findings
        if _touches(diagnostic(finding, positions).range, selected)
        for action in _actions(finding, uri, positions)
    ]


def _actions(finding: Finding, uri: str, positions: Positions) -> Iterator[types.CodeAction]:
    place = finding.place
    if place is None:
        return

    def action(title: str, edits: Iterable[Edit], *, sure: bool) -> types.CodeAction:
        changes = [
            types.TextEdit(positions.range(place.source.place(e.start, e.end)), e.text)
            for e in edits
        ]
        return types.CodeAction(
            title,
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[diagnostic(finding, positions)],
            is_preferred=sure,
            edit=types.WorkspaceEdit(changes={uri: changes}),
        )

    if finding.fix is not None:
        texts = " ".join(edit.text.strip() for edit in finding.fix.edits)
        shown = texts if len(texts) <= 60 else f"{texts[:57]}..."
        title = f"Write `{shown}`" if shown else "Leave it out"
        yield action(title, finding.fix.edits, sure=finding.fix.sure)
    if finding.severity != "error" and finding.code != "useless-silence":
        end = line_end(place.source.text, place.start)
        comment = Edit(end, end, f"  ; serp: ignore[{finding.code}]")
        yield action(f"Silence `{finding.code}` in this line", [comment], sure=False)


def _touches(one: types.Range, other: types.Range) -> bool:
    return one.start <= other.end and other.start <= one.end
