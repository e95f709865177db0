"""What is known of a file, as the Language Server Protocol has it."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator

from lsprotocol import types

from serp.authoring.language_server.completion import choices, explained
from serp.authoring.language_server.index import Index, NameKind, Occurrence
from serp.authoring.lint.findings import Finding, Severity
from serp.errors import SerpError
from serp.pddl import syntax as x
from serp.pddl.reader import Group
from serp.pddl.scope import RESERVED_WORDS
from serp.pddl.source import Edit, Place, Source, line_end

_ENCODINGS = {"utf-8": ("utf-8", 1), "utf-16": ("utf-16-le", 2), "utf-32": ("utf-32-le", 4)}


class Positions:
    """Converts between characters of a text and positions of an editor."""

    def __init__(self, encoding: str) -> None:
        """`encoding` is utf-8, utf-16 or utf-32, as client and server agreed."""
        self._encoding, self._bytes = _ENCODINGS[encoding]

    def position(self, source: Source, offset: int) -> types.Position:
        """Return the position of a character."""
        place = Place(source, offset, offset)
        before = source.line_text(place.line)[: place.column - 1]
        return types.Position(place.line - 1, len(before.encode(self._encoding)) // self._bytes)

    def offset(self, source: Source, position: types.Position) -> int:
        """Return the character at a position; the nearest one where there is none."""
        line = min(position.line + 1, len(source.line_starts))
        text = source.line_text(line).encode(self._encoding)
        before = text[: position.character * self._bytes].decode(self._encoding, "ignore")
        return source.line_starts[line - 1] + len(before)

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


_NAME = re.compile(r"[a-z][a-z0-9_\-]*\Z", re.IGNORECASE | re.ASCII)
_FIXED = (x.REWARD, x.UNSAFE, x.TERMINAL, x.OBJECT)


def renamable(index: Index, source: Source, position: int) -> Occurrence | None:
    """Return the name at a position where the files declare it, and it is not reserved."""
    here = index.at(source, position)
    if here is None or here.name in _FIXED or index.declaration(here) is None:
        return None
    return here


def renamed(index: Index, source: Source, position: int, name: str) -> list[Place]:
    """Return all places of a name that is to be another one.

    Raises:
        SerpError: There is nothing to rename, or the new name is none, or is taken.
    """
    here = renamable(index, source, position)
    if here is None:
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


def silence(finding: Finding) -> Edit | None:
    """Return the edit that puts the comment which silences a warning; None for an error."""
    place = finding.place
    if finding.severity == "error" or place is None or finding.code == "useless-silence":
        return None
    end = line_end(place.source.text, place.start)
    comment = f"  ; serp: ignore[{finding.code}]"
    return Edit(end, end, comment)


_START = types.Range(types.Position(0, 0), types.Position(0, 0))
_COMPLETIONS = {
    "keyword": types.CompletionItemKind.Keyword,
    "predicate": types.CompletionItemKind.Property,
    "function": types.CompletionItemKind.Field,
    "type": types.CompletionItemKind.Class,
    "object": types.CompletionItemKind.Constant,
    "variable": types.CompletionItemKind.Variable,
}
_SEVERITIES: dict[Severity, types.DiagnosticSeverity] = {
    "error": types.DiagnosticSeverity.Error,
    "warning": types.DiagnosticSeverity.Warning,
    "note": types.DiagnosticSeverity.Information,
}
_SYMBOLS = {
    NameKind.ACTION: types.SymbolKind.Method,
    NameKind.PROCESS: types.SymbolKind.Operator,
    NameKind.EVENT: types.SymbolKind.Event,
    NameKind.PREDICATE: types.SymbolKind.Boolean,
    NameKind.FUNCTION: types.SymbolKind.Number,
    NameKind.TYPE: types.SymbolKind.Class,
    NameKind.OBJECT: types.SymbolKind.Constant,
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


def completions(
    index: Index, source: Source, position: int, positions: Positions
) -> list[types.CompletionItem]:
    """Return what can stand at a position."""
    return [
        types.CompletionItem(
            choice.text,
            kind=_COMPLETIONS[choice.kind],
            detail=choice.detail or None,
            documentation=choice.explanation or None,
            sort_text=f"{number:04}",
            text_edit=types.TextEdit(
                positions.range(source.place(choice.start, position)), choice.text
            ),
        )
        for number, choice in enumerate(choices(index, source, position))
    ]


def hover(index: Index, source: Source, position: int, positions: Positions) -> types.Hover | None:
    """Return what is known of the word at a position."""
    found = explained(index, source, position)
    if found is None:
        return None
    text, place = found
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, positions.range(place))


def symbols(index: Index, positions: Positions) -> list[types.DocumentSymbol]:
    """Return the outline of a file: its sections, and what each of them declares."""
    declared: dict[Place, list[Occurrence]] = defaultdict(list)
    for occurrence in index.declared(*_SYMBOLS):
        declared[occurrence.inside].append(occurrence)
    return [
        _section(section, declared[section.place.opening], positions) for section in index.sections
    ]


def _section(
    section: Group, declared: list[Occurrence], positions: Positions
) -> types.DocumentSymbol:
    schemas = (NameKind.ACTION, NameKind.PROCESS, NameKind.EVENT)
    schema = next((o for o in declared if o.kind in schemas), None)
    opening = section.place.opening
    return types.DocumentSymbol(
        schema.name if schema is not None else section.head or "()",
        _SYMBOLS[schema.kind] if schema is not None else types.SymbolKind.Namespace,
        positions.range(section.place),
        positions.range(schema.place if schema is not None else opening),
        detail=schema.kind.value if schema is not None else None,
        children=[_name(o, positions) for o in declared if o is not schema],
    )


def _name(occurrence: Occurrence, positions: Positions) -> types.DocumentSymbol:
    return types.DocumentSymbol(
        occurrence.name,
        _SYMBOLS[occurrence.kind],
        positions.range(occurrence.form),
        positions.range(occurrence.place),
        detail=occurrence.type or None,
    )


def code_actions(
    findings: Iterable[Finding], uri: str, asked: types.Range, positions: Positions
) -> list[types.CodeAction]:
    """Return what can be done about the findings in a range."""
    return [
        action
        for finding in findings
        if _touches(diagnostic(finding, positions).range, asked)
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
    if (comment := silence(finding)) is not None:
        yield action(f"Silence `{finding.code}` in this line", [comment], sure=False)


def _touches(one: types.Range, other: types.Range) -> bool:
    def key(position: types.Position) -> tuple[int, int]:
        return position.line, position.character

    return key(one.start) <= key(other.end) and key(other.start) <= key(one.end)
