"""The language server: `serp lsp`, over standard input and output."""

from __future__ import annotations

import asyncio
import functools
import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from lsprotocol import types
from pygls import uris
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.workspace import PositionCodec

from serp import __version__
from serp.authoring.language_server.names import (
    Index,
    completions,
    explained,
    typed_before,
    word_at,
)
from serp.authoring.lint.domain_pairs import domain_beside, domain_not_found, title_of
from serp.authoring.lint.findings import Finding, Severity, examine
from serp.authoring.lint.formatting import formatted
from serp.authoring.scenarios.syntax import SUFFIX
from serp.errors import SerpError
from serp.model.domain import Domain, problem_beside
from serp.pddl.source import DomainError, Place, Recovery, Source


class Files(NamedTuple):
    """An open file, and the domain and problem that it is read with; either may be unknown."""

    opened: Source
    domain: Source | None
    problem: Source | None

    @property
    def sources(self) -> tuple[Source, ...]:
        """Domain and problem, as far as they are known."""
        return tuple(source for source in (self.domain, self.problem) if source is not None)


@functools.lru_cache(maxsize=32)
def text_of(name: str, text: str) -> Source:
    """Return a file with a text; the same object for the same text, as caches need it."""
    return Source(name, text)


index_of = functools.lru_cache(maxsize=4)(Index)
_examined = functools.lru_cache(maxsize=16)(examine)


def findings_in(files: Files) -> list[Finding]:
    """Return the findings of an open file: of a domain, a problem, or scenarios."""
    opened, scenarios = files.opened, files.opened not in files.sources
    if files.domain is None:
        return [] if scenarios else [Finding.of(domain_not_found(opened))]
    examined = _examined(files.domain, files.problem)
    if scenarios:
        return _of_scenarios(opened, examined.domain)
    own = [(f.place.source if f.place else files.domain, f) for f in examined.findings]
    return [finding for source, finding in own if source.name == opened.name]


def _of_scenarios(source: Source, domain: Domain | None) -> list[Finding]:
    """Return what cannot be read in scenarios; nothing while the domain is wrong."""
    from serp.authoring.scenarios.reading import observed_in, read_scenarios

    if domain is None:
        return []
    recovery = Recovery()
    observed = observed_in(source, domain)
    read_scenarios(Source(source.name, source.text, recovery=recovery), observed, observed.model)
    return [Finding.of(error) for error in recovery.errors]


# Positions and quick fixes -----------------------------------------------------------------------


class Positions:
    """Converts between characters of a text and positions as the editor counts them."""

    def __init__(self, codec: PositionCodec | None = None) -> None:
        self._codec = codec or PositionCodec()

    def position(self, source: Source, offset: int) -> types.Position:
        """Return the position of a character."""
        place = source.place(offset, offset)
        before = place.source_line[: place.column - 1]
        return types.Position(place.line - 1, self._codec.client_num_units(before))

    def offset(self, source: Source, position: types.Position) -> int:
        """Return the character at a position; the nearest one where there is none."""
        line = min(position.line, len(source.line_starts) - 1)
        within = types.Position(0, position.character)
        at = self._codec.position_from_client_units([f"{source.line_text(line + 1)}\n"], within)
        return min(source.line_starts[line] + at.character, len(source.text))

    def range(self, place: Place) -> types.Range:
        """Return where a place is."""
        return types.Range(
            self.position(place.source, place.start), self.position(place.source, place.end)
        )


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
        positions.range(finding.place.first_line) if finding.place is not None else _START,
        text,
        severity=_SEVERITIES[finding.severity],
        code=finding.code,
        source="serp",
    )


def code_actions(
    findings: Iterable[Finding], uri: str, selected: types.Range, positions: Positions
) -> Iterator[types.CodeAction]:
    """Yield the fixes of the findings in a range."""
    for finding in findings:
        shown, place, fix = diagnostic(finding, positions), finding.place, finding.fix
        touches = shown.range.start <= selected.end and selected.start <= shown.range.end
        if place is None or fix is None or not touches:
            continue
        texts = " ".join(edit.text.strip() for edit in fix.edits)
        text = texts if len(texts) <= 60 else f"{texts[:57]}..."
        edits = [
            types.TextEdit(positions.range(place.source.place(e.start, e.end)), e.text)
            for e in fix.edits
        ]
        yield types.CodeAction(
            f"Write `{text}`" if text else "Leave it out",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[shown],
            is_preferred=fix.sure,
            edit=types.WorkspaceEdit(changes={uri: edits}),
        )


# The server --------------------------------------------------------------------------------------


class PddlServer(LanguageServer):
    """Knows the files that are open in an editor."""

    def __init__(self) -> None:
        super().__init__(
            "serp", __version__, text_document_sync_kind=types.TextDocumentSyncKind.Full
        )
        self._newest = 0

    @property
    def positions(self) -> Positions:
        """Converts positions as the editor counts."""
        return Positions(self.workspace.position_codec)

    def files(self, uri: str) -> Files:
        """Return a domain, a problem or scenarios with what belongs to them, as in the editor.

        Raises:
            JsonRpcInvalidParams: The file is not open.
        """
        texts = {doc.path: doc.source for doc in self.workspace.text_documents.values()}

        def read(path: Path | None) -> Source | None:
            if path is None:
                return None
            text = texts.get(str(path))
            try:
                return text_of(str(path), Source.read(path).text if text is None else text)
            except SerpError:
                return None

        path = Path(uris.to_fs_path(uri) or uri)
        if str(path) not in texts:  # pygls would read it from the disk
            raise JsonRpcInvalidParams(f"{uri} is not open in the editor")
        opened = text_of(str(path), texts[str(path)])
        if path.suffix == SUFFIX:
            domain = path.with_suffix(".pddl")
            return Files(opened, read(domain), read(problem_beside(domain)))
        title = title_of(opened)
        if title.kind == "problem":
            return Files(opened, read(domain_beside(path, title)), opened)
        return Files(opened, opened, read(problem_beside(path)))

    def indexed(
        self, uri: str, position: types.Position, *, word: bool = False
    ) -> tuple[Index, Source, int]:
        """Return the index of a file and its other half, the file, and a character in it.

        With `word`, it is that of the word behind a parenthesis at the position.
        """
        files = self.files(uri)
        source, offset = files.opened, self.positions.offset(files.opened, position)
        offset += word and source.text.startswith("(", offset)
        return index_of(*files.sources), source, offset

    async def findings(self, opened: Iterable[str]) -> dict[str, list[Finding]]:
        """Return URI of an open file → its findings.

        They come from another thread, so that the editor is answered meanwhile.
        """
        files = {uri: self.files(uri) for uri in opened}
        return await asyncio.to_thread(
            lambda: {uri: findings_in(read) for uri, read in files.items()}
        )

    async def check(self, pause: float = 0.0) -> None:
        """Publish the findings of the open files, unless one changes meanwhile.

        Files that did not change are not examined again.
        """
        self._newest = this = self._newest + 1
        await asyncio.sleep(pause)
        if this != self._newest:
            return
        results = await self.findings(self.workspace.text_documents)
        if this != self._newest:
            return
        for uri, findings in results.items():
            diagnostics = [diagnostic(finding, self.positions) for finding in findings]
            self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, diagnostics))


def uri_of(name: str) -> str:
    """Return how an editor names a file."""
    uri = uris.from_fs_path(name) if Path(name).is_absolute() else None
    return uri or name


class Input(io.BufferedReader):
    """What an editor sends; a message or header that is too long is as the end of the input."""

    def readline(self, size: int | None = -1, /) -> bytes:
        """Return a header."""
        return super().readline(1_000)

    def read(self, size: int | None = -1, /) -> bytes:
        """Return a message of a number of bytes."""
        most = 1 << 28  # as of a file
        return super().read(size) if size is not None and 0 <= size <= most else b""


server = PddlServer()


@server.feature(types.TEXT_DOCUMENT_DID_OPEN)
@server.feature(types.TEXT_DOCUMENT_DID_SAVE)
async def _opened(ls: PddlServer, params: object) -> None:
    await ls.check()


@server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
async def _closed(ls: PddlServer, params: types.DidCloseTextDocumentParams) -> None:
    none = types.PublishDiagnosticsParams(params.text_document.uri, [])
    ls.text_document_publish_diagnostics(none)
    await ls.check()


@server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
async def _changed(ls: PddlServer, params: types.DidChangeTextDocumentParams) -> None:
    # Seconds without a key after which the open files are checked.
    await ls.check(0.15)


@server.feature(
    types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=["(", "?", ":"])
)
def _complete(ls: PddlServer, params: types.CompletionParams) -> list[types.CompletionItem]:
    index, source, offset = ls.indexed(params.text_document.uri, params.position)
    if source not in index.sources:  # scenarios
        return []
    items = completions(index, source, offset)
    start = offset - len(typed_before(source.text[:offset]))
    word = ls.positions.range(source.place(start, offset))
    for number, item in enumerate(items):
        item.sort_text = f"{number:04}"
        item.text_edit = types.TextEdit(word, item.label)
    return items


@server.feature(types.TEXT_DOCUMENT_HOVER)
def _hover(ls: PddlServer, params: types.HoverParams) -> types.Hover | None:
    explanation = explained(*ls.indexed(params.text_document.uri, params.position, word=True))
    if explanation is None:
        return None
    text, place = explanation
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, ls.positions.range(place))


@server.feature(types.TEXT_DOCUMENT_DEFINITION)
def _definition(ls: PddlServer, params: types.DefinitionParams) -> types.Location | None:
    index, source, offset = ls.indexed(params.text_document.uri, params.position, word=True)
    word = word_at(source, offset)
    declared = index.declaration(word) if word is not None else None
    if declared is None:
        return None
    return types.Location(uri_of(declared.place.source.name), ls.positions.range(declared.place))


@server.feature(types.TEXT_DOCUMENT_FORMATTING)
def _format(ls: PddlServer, params: types.DocumentFormattingParams) -> list[types.TextEdit] | None:
    source = ls.files(params.text_document.uri).opened
    try:
        text = formatted(source)
    except DomainError:  # it is among the diagnostics
        return None
    whole = ls.positions.range(source.place(0, len(source.text)))
    return [types.TextEdit(whole, text)] if text != source.text else []


@server.feature(
    types.TEXT_DOCUMENT_CODE_ACTION,
    types.CodeActionOptions(code_action_kinds=[types.CodeActionKind.QuickFix]),
)
async def _fixes(ls: PddlServer, params: types.CodeActionParams) -> list[types.CodeAction]:
    uri = params.text_document.uri
    findings = (await ls.findings([uri]))[uri]
    return [*code_actions(findings, uri, params.range, ls.positions)]
