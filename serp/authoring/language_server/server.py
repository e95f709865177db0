"""The language server: `serp lsp`, over standard input and output."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lsprotocol import types
from pygls import uris
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer

from serp import __version__
from serp.authoring.language_server import features
from serp.authoring.language_server import features as actions
from serp.authoring.language_server.features import Positions
from serp.authoring.language_server.index import Index
from serp.authoring.lint.domain_pairs import domain_beside, domain_not_found, title_of
from serp.authoring.lint.findings import Examined, Finding, examine
from serp.authoring.lint.formatting import formatted
from serp.authoring.scenarios.syntax import SUFFIX
from serp.errors import SerpError
from serp.model.domain import Domain, problem_beside
from serp.pddl.source import DomainError, Place, Recovery, Source


class OpenPair(NamedTuple):
    """A domain, and a problem of it; either may be unknown.

    Attributes:
        asked: The file that was asked for: one of the two, or scenarios of the domain.
        domain: None for a problem or scenarios whose domain is not found.
        problem: None where there is none.
    """

    asked: Source
    domain: Source | None
    problem: Source | None

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files of PDDL that are known."""
        return tuple(source for source in (self.domain, self.problem) if source is not None)


@functools.lru_cache(maxsize=16)
def text_of(name: str, text: str) -> Source:
    """Return a file with a text; the same one for the same text, which caches rely on."""
    return Source(name, text)


def pair_of(asked: Source, opened: Callable[[Path], str | None]) -> OpenPair:
    """Return a file with the one that belongs to it.

    Args:
        asked: A domain, a problem, or scenarios; its name is its path.
        opened: Path → its text in the editor; None where it is not open there.
    """

    def read(path: Path | None) -> Source | None:
        if path is None:
            return None
        text = opened(path)
        try:
            return text_of(str(path), Source.read(path).text if text is None else text)
        except SerpError:
            return None

    path = Path(asked.name)
    if path.suffix == SUFFIX:
        domain = path.with_suffix(".pddl")
        return OpenPair(asked, read(domain), read(problem_beside(domain)))
    title = title_of(asked)
    if title.kind == "problem":
        return OpenPair(asked, read(domain_beside(path, title)), asked)
    return OpenPair(asked, asked, read(problem_beside(path)))


def findings_in(pair: OpenPair) -> dict[str, list[Finding]]:
    """Return the name of each file → its findings: of both files of a pair, or of scenarios."""
    scenarios = pair.asked not in pair.sources
    if pair.domain is None:
        # Of scenarios there is nothing to be said without a domain.
        missing = [] if scenarios else [Finding.of(domain_not_found(pair.asked))]
        return {pair.asked.name: missing}
    found = _examined(pair.domain, pair.problem)
    if scenarios:
        return {pair.asked.name: _of_scenarios(pair.asked, found.domain)}
    return {
        source.name: [
            finding
            for finding in found.findings
            if (finding.place.source.name if finding.place else pair.domain.name) == source.name
        ]
        for source in pair.sources
    }


@functools.lru_cache(maxsize=4)
def _examined(domain: Source, problem: Source | None) -> Examined:
    return examine(domain, problem)


def _of_scenarios(source: Source, domain: Domain | None) -> list[Finding]:
    """Return what cannot be read in scenarios; nothing while the domain is wrong."""
    from serp.authoring.scenarios.reading import observed_in, read_scenarios

    if domain is None:
        return []
    recovery = Recovery()
    observed = observed_in(source, domain)
    read_scenarios(Source(source.name, source.text, recovery=recovery), observed, observed.model)
    return [Finding.of(error) for error in recovery.errors]


_PAUSE = 0.15
"""Seconds without a key after which a file is checked."""
_WATCHED = ("**/*.pddl", f"**/*{SUFFIX}")
"""What the editor tells of where it is changed outside of it."""
index_of = functools.lru_cache(maxsize=4)(Index)


class PddlServer(LanguageServer):
    """Knows the files that are open in an editor."""

    def __init__(self) -> None:
        super().__init__(
            "serp", __version__, text_document_sync_kind=types.TextDocumentSyncKind.Full
        )
        self._asked: dict[str, int] = {}
        self._shown: dict[str, set[str]] = {}
        self._checking = asyncio.Lock()

    @property
    def positions(self) -> Positions:
        """Converts positions as the editor counts."""
        return Positions(str(getattr(self.workspace.position_encoding, "value", "utf-16")))

    def source(self, uri: str) -> Source:
        """Return a file as it is in the editor."""
        document = self.workspace.get_text_document(uri)
        return text_of(uris.to_fs_path(uri) or uri, document.source)

    def pair(self, uri: str) -> OpenPair:
        """Return a file with the one that belongs to it."""
        texts = {doc.path: doc.source for doc in self.workspace.text_documents.values()}
        return pair_of(self.source(uri), lambda path: texts.get(str(path)))

    def found(self, uri: str, position: types.Position) -> tuple[Index, Source, int]:
        """Return the index of a file and its other half, the file, and a position in it."""
        pair = self.pair(uri)
        return index_of(*pair.sources), pair.asked, self.positions.offset(pair.asked, position)

    def word(self, uri: str, position: types.Position) -> tuple[Index, Source, int]:
        """Return what `found` does, for the word behind a parenthesis at the position."""
        index, source, offset = self.found(uri, position)
        return index, source, offset + source.text.startswith("(", offset)

    async def findings(self, uri: str) -> dict[str, list[Finding]]:
        """Return the name of each file that is read with one → its findings.

        They come from another thread, so that the editor is answered meanwhile. One file is checked
        at a time: two would take turns, and both be late.
        """
        async with self._checking:
            return await asyncio.to_thread(findings_in, self.pair(uri))

    def location(self, place: Place) -> types.Location:
        """Return a place as the editor names it."""
        return types.Location(uri_of(place.source), self.positions.range(place))

    async def check(self, uri: str, pause: float = 0.0) -> None:
        """Publish the findings of a file and of those that it is read with.

        Of these, what is open itself is checked again by itself.
        """
        opened = self.workspace.text_documents
        name = self.source(uri).name
        others = [other for other in opened if other != uri
                  and any(source.name == name for source in self.pair(other).sources)]  # fmt: skip
        await asyncio.gather(*(self._check(each, pause) for each in (uri, *others)))

    async def _check(self, uri: str, pause: float) -> None:
        """Publish findings, unless the file changes before there are any."""
        self._asked[uri] = asked = self._asked.get(uri, 0) + 1

        def outdated() -> bool:
            return self._asked[uri] != asked or uri not in self.workspace.text_documents

        await asyncio.sleep(pause)
        async with self._checking:
            if not outdated():
                found = await asyncio.to_thread(findings_in, self.pair(uri))
        if outdated():
            return
        own = self.source(uri).name
        opened = {document.path for document in self.workspace.text_documents.values()}
        shown = {
            uri if name == own else uri_of(Source(name, "")): findings
            for name, findings in found.items()
            if name == own or name not in opened
        }
        self.show({**{old: [] for old in self._shown.get(uri, ())}, **shown})
        self._shown[uri] = set(shown)

    def show(self, found: dict[str, list[Finding]]) -> None:
        """Publish the findings of files."""
        for uri, findings in found.items():
            diagnostics = [features.diagnostic(finding, self.positions) for finding in findings]
            self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, diagnostics))

    async def forget(self, uri: str) -> None:
        """Take back what was published because a file was open, and check those it belongs to."""
        self.show({old: [] for old in self._shown.pop(uri, ())})
        await self.check_all()

    async def check_all(self) -> None:
        """Check all open files."""
        await asyncio.gather(*(self._check(uri, 0.0) for uri in self.workspace.text_documents))


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
    async def closed(ls: PddlServer, params: types.DidCloseTextDocumentParams) -> None:
        await ls.forget(params.text_document.uri)

    @pddl.feature(types.INITIALIZED)
    async def begun(ls: PddlServer, params: types.InitializedParams) -> None:
        asked = ls.client_capabilities.workspace
        watching = asked.did_change_watched_files if asked is not None else None
        if watching is not None and watching.dynamic_registration:
            watchers = [types.FileSystemWatcher(pattern) for pattern in _WATCHED]
            wish = types.Registration(
                "files",
                types.WORKSPACE_DID_CHANGE_WATCHED_FILES,
                types.DidChangeWatchedFilesRegistrationOptions(watchers),
            )
            await ls.client_register_capability_async(types.RegistrationParams([wish]))

    @pddl.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    async def changed_elsewhere(ls: PddlServer, params: types.DidChangeWatchedFilesParams) -> None:
        await ls.check_all()


def _add_reading(pddl: PddlServer) -> None:
    @pddl.feature(
        types.TEXT_DOCUMENT_COMPLETION,
        types.CompletionOptions(trigger_characters=["(", "?", ":"]),
    )
    def complete(ls: PddlServer, params: types.CompletionParams) -> list[types.CompletionItem]:
        index, source, position = ls.found(params.text_document.uri, params.position)
        if source not in index.sources:  # scenarios
            return []
        return features.completions(index, source, position, ls.positions)

    @pddl.feature(types.TEXT_DOCUMENT_HOVER)
    def hover(ls: PddlServer, params: types.HoverParams) -> types.Hover | None:
        index, source, position = ls.word(params.text_document.uri, params.position)
        return features.hover(index, source, position, ls.positions)

    @pddl.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def symbols(ls: PddlServer, params: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        source = ls.source(params.text_document.uri)
        return features.symbols(index_of(source), ls.positions)


def _add_names(pddl: PddlServer) -> None:
    @pddl.feature(types.TEXT_DOCUMENT_DEFINITION)
    def definition(ls: PddlServer, params: types.DefinitionParams) -> types.Location | None:
        index, source, position = ls.word(params.text_document.uri, params.position)
        here = index.at(source, position)
        declared = index.declaration(here) if here is not None else None
        return ls.location(declared.place) if declared is not None else None

    @pddl.feature(types.TEXT_DOCUMENT_REFERENCES)
    def references(ls: PddlServer, params: types.ReferenceParams) -> list[types.Location]:
        index, source, position = ls.word(params.text_document.uri, params.position)
        here = index.at(source, position)
        return [ls.location(o.place) for o in index.same(here)] if here is not None else []

    @pddl.feature(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlight(
        ls: PddlServer, params: types.DocumentHighlightParams
    ) -> list[types.DocumentHighlight]:
        index, source, position = ls.word(params.text_document.uri, params.position)
        here = index.at(source, position)
        return [
            types.DocumentHighlight(ls.positions.range(o.place))
            for o in (index.same(here) if here is not None else [])
            if o.place.source.name == source.name
        ]

    @pddl.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare(ls: PddlServer, params: types.PrepareRenameParams) -> types.Range | None:
        index, source, position = ls.word(params.text_document.uri, params.position)
        here = actions.renamable(index, source, position)
        return ls.positions.range(here.place) if here is not None else None

    @pddl.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def rename(ls: PddlServer, params: types.RenameParams) -> types.WorkspaceEdit | None:
        index, source, position = ls.word(params.text_document.uri, params.position)
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
    async def mend(ls: PddlServer, params: types.CodeActionParams) -> list[types.CodeAction]:
        uri = params.text_document.uri
        found = (await ls.findings(uri))[ls.source(uri).name]
        return features.code_actions(found, uri, params.range, ls.positions)
