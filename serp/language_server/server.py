"""The language server: `serp lsp`, over standard input and output."""

from __future__ import annotations

import asyncio
from pathlib import Path

from lsprotocol import types
from pygls import uris
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer

from serp import __version__
from serp.errors import SerpError
from serp.language_server import actions, features
from serp.language_server.documents import OpenPair, findings_in, pair_of
from serp.language_server.index import Index
from serp.language_server.positions import Positions
from serp.lint.findings import Finding
from serp.lint.formatting import formatted
from serp.pddl.source import DomainError, Place, Source

_PAUSE = 0.15
"""Seconds without a key after which a file is checked."""


class PddlServer(LanguageServer):
    """Knows the files that are open in an editor."""

    def __init__(self) -> None:
        super().__init__(
            "serp", __version__, text_document_sync_kind=types.TextDocumentSyncKind.Full
        )
        self._asked: dict[str, int] = {}

    @property
    def positions(self) -> Positions:
        """Converts positions as the editor counts."""
        return Positions(str(getattr(self.workspace.position_encoding, "value", "utf-16")))

    def source(self, uri: str) -> Source:
        """Return a file as it is in the editor."""
        document = self.workspace.get_text_document(uri)
        return Source(uris.to_fs_path(uri) or uri, document.source)

    def pair(self, uri: str) -> OpenPair:
        """Return a file with the one that belongs to it."""
        texts = {doc.path: doc.source for doc in self.workspace.text_documents.values()}
        return pair_of(self.source(uri), lambda path: texts.get(str(path)))

    def found(self, uri: str, position: types.Position) -> tuple[Index, Source, int]:
        """Return the index of a file and its other half, the file, and a position in it."""
        pair = self.pair(uri)
        return Index(*pair.sources), pair.asked, self.positions.offset(pair.asked, position)

    def findings(self, uri: str) -> list[Finding]:
        """Return the findings of one file."""
        pair = self.pair(uri)
        return findings_in(pair)[pair.asked.name]

    def location(self, place: Place) -> types.Location:
        """Return a place as the editor names it."""
        return types.Location(uri_of(place.source), self.positions.range(place))

    async def check(self, uri: str, pause: float = 0.0) -> None:
        """Publish the findings of a file, unless it changes during the pause."""
        self._asked[uri] = asked = self._asked.get(uri, 0) + 1
        await asyncio.sleep(pause)
        if self._asked[uri] != asked or uri not in self.workspace.text_documents:
            return
        found = await asyncio.to_thread(findings_in, self.pair(uri))
        if self._asked[uri] != asked or uri not in self.workspace.text_documents:
            return
        for name, findings in found.items():
            self.text_document_publish_diagnostics(
                types.PublishDiagnosticsParams(
                    uri if name == self.source(uri).name else uri_of(Source(name, "")),
                    [features.diagnostic(finding, self.positions) for finding in findings],
                )
            )


def uri_of(source: Source) -> str:
    """Return how an editor names a file."""
    uri = uris.from_fs_path(source.name) if Path(source.name).is_absolute() else None
    return uri or source.name


def server() -> PddlServer:
    """Return a server with all that it can do."""
    pddl = PddlServer()
    _add_checks(pddl)
    _add_reading(pddl)
    _add_names(pddl)
    _add_edits(pddl)
    return pddl


def _add_checks(pddl: PddlServer) -> None:
    @pddl.feature(types.TEXT_DOCUMENT_DID_OPEN)
    async def opened(ls: PddlServer, params: types.DidOpenTextDocumentParams) -> None:
        await ls.check(params.text_document.uri)

    @pddl.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    async def changed(ls: PddlServer, params: types.DidChangeTextDocumentParams) -> None:
        await ls.check(params.text_document.uri, _PAUSE)

    @pddl.feature(types.TEXT_DOCUMENT_DID_SAVE)
    async def saved(ls: PddlServer, params: types.DidSaveTextDocumentParams) -> None:
        await ls.check(params.text_document.uri)

    @pddl.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(ls: PddlServer, params: types.DidCloseTextDocumentParams) -> None:
        uri = params.text_document.uri
        ls.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, []))


def _add_reading(pddl: PddlServer) -> None:
    @pddl.feature(
        types.TEXT_DOCUMENT_COMPLETION,
        types.CompletionOptions(trigger_characters=["(", "?", ":"]),
    )
    def complete(ls: PddlServer, params: types.CompletionParams) -> list[types.CompletionItem]:
        index, source, position = ls.found(params.text_document.uri, params.position)
        return features.completions(index, source, position, ls.positions)

    @pddl.feature(types.TEXT_DOCUMENT_HOVER)
    def hover(ls: PddlServer, params: types.HoverParams) -> types.Hover | None:
        index, source, position = ls.found(params.text_document.uri, params.position)
        return features.hover(index, source, position, ls.positions)

    @pddl.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def symbols(ls: PddlServer, params: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        source = ls.source(params.text_document.uri)
        return features.symbols(Index(source), ls.positions)


def _add_names(pddl: PddlServer) -> None:
    @pddl.feature(types.TEXT_DOCUMENT_DEFINITION)
    def definition(ls: PddlServer, params: types.DefinitionParams) -> types.Location | None:
        index, source, position = ls.found(params.text_document.uri, params.position)
        here = index.at(source, position)
        declared = index.declaration(here) if here is not None else None
        return ls.location(declared.place) if declared is not None else None

    @pddl.feature(types.TEXT_DOCUMENT_REFERENCES)
    def references(ls: PddlServer, params: types.ReferenceParams) -> list[types.Location]:
        index, source, position = ls.found(params.text_document.uri, params.position)
        here = index.at(source, position)
        return [ls.location(o.place) for o in index.same(here)] if here is not None else []

    @pddl.feature(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlight(
        ls: PddlServer, params: types.DocumentHighlightParams
    ) -> list[types.DocumentHighlight]:
        index, source, position = ls.found(params.text_document.uri, params.position)
        here = index.at(source, position)
        return [
            types.DocumentHighlight(ls.positions.range(o.place))
            for o in (index.same(here) if here is not None else [])
            if o.place.source.name == source.name
        ]

    @pddl.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare(ls: PddlServer, params: types.PrepareRenameParams) -> types.Range | None:
        index, source, position = ls.found(params.text_document.uri, params.position)
        here = actions.renamable(index, source, position)
        return ls.positions.range(here.place) if here is not None else None

    @pddl.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def rename(ls: PddlServer, params: types.RenameParams) -> types.WorkspaceEdit | None:
        index, source, position = ls.found(params.text_document.uri, params.position)
        try:
            places = actions.renamed(index, source, position, params.new_name)
        except SerpError as error:
            raise JsonRpcInvalidParams(str(error)) from None
        changes: dict[str, list[types.TextEdit]] = {}
        for place in places:
            edit = types.TextEdit(ls.positions.range(place), params.new_name)
            changes.setdefault(uri_of(place.source), []).append(edit)
        return types.WorkspaceEdit(changes=changes)


def _add_edits(pddl: PddlServer) -> None:
    @pddl.feature(types.TEXT_DOCUMENT_FORMATTING)
    def layout(
        ls: PddlServer, params: types.DocumentFormattingParams
    ) -> list[types.TextEdit] | None:
        source = ls.source(params.text_document.uri)
        try:
            text = formatted(source)
        except DomainError:  # it is among the diagnostics
            return None
        whole = ls.positions.range(source.place(0, len(source.text)))
        return [types.TextEdit(whole, text)] if text != source.text else []

    @pddl.feature(
        types.TEXT_DOCUMENT_CODE_ACTION,
        types.CodeActionOptions(code_action_kinds=[types.CodeActionKind.QuickFix]),
    )
    def mend(ls: PddlServer, params: types.CodeActionParams) -> list[types.CodeAction]:
        uri = params.text_document.uri
        return features.code_actions(ls.findings(uri), uri, params.range, ls.positions)
