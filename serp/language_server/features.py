"""What is known of a file, as the Language Server Protocol has it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from lsprotocol import types

from serp.language_server.actions import silence
from serp.language_server.completion import choices
from serp.language_server.hover import explained
from serp.language_server.index import Index, NameKind, Occurrence
from serp.language_server.positions import Positions
from serp.lint.findings import Finding, Severity
from serp.pddl.edits import Edit
from serp.pddl.sexpr import Group
from serp.pddl.source import Place, Source

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
