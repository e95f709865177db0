"""The language server, asked by a client over standard input and output."""

import asyncio
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

pytest.importorskip("pygls")

from lsprotocol import types
from pygls.exceptions import JsonRpcException
from pygls.lsp.client import LanguageClient

from serp.authoring.language_server.names import Index, completions, explained, word_at
from serp.authoring.language_server.server import Positions, code_actions, uri_of
from serp.authoring.lint.findings import examine
from serp.pddl.source import Source
from tests.serp.pddl.test_fuzz import SHIPPED, damage
from tests.serp.ui.cli.conftest import WALK, WALK_PROBLEM


class Client(LanguageClient):
    """A client that notes how the server ended."""

    status: int | None = None

    async def server_exit(self, server):
        self.status = server.returncode


class Editor:
    """An editor with some files open."""

    def __init__(self, client, folder):
        self.client = client
        self.folder = folder
        self.published = {}
        self.news = asyncio.Event()
        self.texts = {}

    def uri(self, name):
        return uri_of(str(self.folder / name))

    def see(self, params):
        self.published.setdefault(Path(params.uri).name, []).append(list(params.diagnostics))
        self.news.set()

    def open(self, name, text):
        self.texts[name] = text
        document = types.TextDocumentItem(self.uri(name), "pddl", 1, text)
        self.client.text_document_did_open(types.DidOpenTextDocumentParams(document))

    def type(self, name, text):
        self.texts[name] = text
        document = types.VersionedTextDocumentIdentifier(2, self.uri(name))
        change = types.TextDocumentContentChangeWholeDocument(text)
        self.client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))

    async def until(self, name, *codes):
        """Wait until the findings of a file are of some codes."""
        while name not in self.published or [d.code for d in self.published[name][-1]] != [*codes]:
            self.news.clear()
            await asyncio.wait_for(self.news.wait(), 20)
        return self.published[name][-1]

    def at(self, name, words, offset=1):
        before = self.texts[name][: self.texts[name].index(words) + offset]
        line = before.rpartition("\n")[2]
        units = len(line.encode("utf-16-le")) // 2
        position = types.Position(before.count("\n"), units)
        return {"text_document": types.TextDocumentIdentifier(self.uri(name)), "position": position}


def in_editor(folder, use):
    async def run():
        client = Client("editor", "1")
        editor = Editor(client, folder)
        client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)(lambda found: editor.see(found))
        await client.start_io(sys.executable, "-m", "serp", "lsp")
        capabilities = types.ClientCapabilities()
        await client.initialize_async(types.InitializeParams(capabilities))
        client.initialized(types.InitializedParams())
        await use(editor)
        await client.shutdown_async(None)
        client.exit(None)
        await client.stop()
        assert client.status == 0

    asyncio.run(asyncio.wait_for(run(), 60))


def test_an_editor_is_served_while_files_are_being_written(tmp_path):
    # The file on the disk is older than the one in the editor; its problem is not open at first.
    (tmp_path / "walk.pddl").write_text("(define (domain old))")
    (tmp_path / "walk-problem.pddl").write_text(WALK_PROBLEM)
    text = WALK.replace("(walked) (reward))", "(walked)  ; métres 🤖 walked\n    (reward))")

    async def use(editor):
        client = editor.client
        editor.open("walk.pddl", text)
        await editor.until("walk.pddl")
        await completes_and_explains(editor)
        await finds(editor)
        editor.type("walk.pddl", text.replace("(increase (walked) 1)", "(increase (walkd) 1)"))
        (found,) = await editor.until("walk.pddl", "unknown-name")
        assert found.severity == types.DiagnosticSeverity.Error
        assert (found.range.start.line, found.range.start.character) == (10, 50)
        params = types.CodeActionParams(
            types.TextDocumentIdentifier(editor.uri("walk.pddl")),
            found.range,
            types.CodeActionContext([found]),
        )
        (action,) = await client.text_document_code_action_async(params) or []
        assert isinstance(action, types.CodeAction) and action.title == "Write `walked`"
        assert edits(action.edit) == {"walk.pddl": ["walked"]}
        editor.open("walk-problem.pddl", WALK_PROBLEM.replace("(at home)", "(at hom)"))
        await editor.until("walk-problem.pddl", "unknown-name")
        warned = text.replace("(assign (walked) 0)", "(increase (walked) 0)")
        editor.type("walk.pddl", warned)
        await editor.until("walk.pddl", "no-change")

    in_editor(tmp_path, use)


def test_a_file_that_is_not_open_is_not_read_and_a_message_without_end_ends_the_server(tmp_path):
    (tmp_path / "secret.pddl").write_text(WALK)

    async def use(editor):
        document = types.TextDocumentIdentifier(editor.uri("secret.pddl"))
        asked = types.HoverParams(document, types.Position(0, 10))
        with pytest.raises(JsonRpcException, match="is not open in the editor"):
            await editor.client.text_document_hover_async(asked)

    in_editor(tmp_path, use)
    command = [sys.executable, "-m", "serp", "lsp"]
    sent = b"Content-Length: 99999999999999\r\n\r\n{}"
    ended = subprocess.run(command, input=sent, capture_output=True, timeout=30)
    assert (ended.returncode, ended.stdout) == (0, b"") and b"Traceback" not in ended.stderr


async def completes_and_explains(editor):
    client = editor.client
    found = await client.text_document_completion_async(
        types.CompletionParams(**editor.at("walk.pddl", "(walked) 1)", 3))
    )
    (item,) = found if isinstance(found, list) else []
    assert (item.label, item.documentation) == ("walked", "métres 🤖 walked")
    hover = await client.text_document_hover_async(
        types.HoverParams(**editor.at("walk.pddl", "(walked) 1)"))
    )
    assert hover is not None and isinstance(hover.contents, types.MarkupContent)
    for text in (
        "métres 🤖 walked",
        "`action go` (line 11), `action rest` (lines 15, 16)",
        "`:init` (line ",
    ):
        assert text in hover.contents.value
    document = types.TextDocumentIdentifier(editor.uri("walk.pddl"))
    options = types.FormattingOptions(2, True)
    edited = await client.text_document_formatting_async(
        types.DocumentFormattingParams(document, options)
    )
    assert [edit.new_text for edit in edited or []] == [editor.texts["walk.pddl"].lstrip("\n")]


async def finds(editor):
    client = editor.client
    here = editor.at("walk.pddl", "(mined ?b)")
    definition = await client.text_document_definition_async(types.DefinitionParams(**here))
    assert definition.range.start.line == 4


def edits(change):
    assert change is not None and change.changes is not None
    return {
        Path(uri).name: [edit.new_text for edit in found] for uri, found in change.changes.items()
    }


POSITIONS = Positions()


def test_damaged_files_are_explained_as_far_as_they_can_be_read():
    for seed in range(25):
        random = Random(seed)
        texts = damage(random.choice(SHIPPED), random)
        source = Source("d.pddl", texts.domain)
        index = Index(source)
        whole = POSITIONS.range(source.place(0, len(source.text)))
        list(code_actions(examine(source).findings, "d.pddl", whole, POSITIONS))
        for _ in range(15):
            position = random.randrange(len(source.text) + 1)
            at = POSITIONS.position(source, position)
            assert POSITIONS.offset(source, at) == position
            explained(index, source, position)
            completions(index, source, position)
            word = word_at(source, position)
            if word is not None and (declared := index.declaration(word)) is not None:
                assert declared.place.text.lower() == declared.name == word.text.lower()
