"""The page of the studio: the files on the left, what they mean on the right."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from serp._util.figures import page_colours
from serp._util.templates import render
from serp._util.text import percent, readable
from serp.agent.sentences import kind_of_return, line_of_run, runs_of
from serp.ui.studio.document import Document
from serp.ui.studio.pages.editor import EditorPane
from serp.ui.studio.pages.live import Jump, Live, follow_places
from serp.ui.studio.pages.situation import ScenePane
from serp.ui.studio.session import Session
from serp.ui.studio.view import View


async def show_page(session: Session) -> None:
    """Build the page for a browser that has just called; it takes the studio from an older one.

    It does so when the page is there and connected: a request alone changes nothing.
    """
    style = Path(__file__).with_name("studio.css").read_text(encoding="utf-8")
    ui.add_css(page_colours() + style)
    client = ui.context.client
    await client.connected()
    live = Live(session)

    def let_go() -> None:
        live.close()
        if client.is_deleted:
            return
        client.content.clear()  # what this tab still sends, perhaps after a pause, finds nobody
        with client.content, ui.card().classes("serp-elsewhere"):
            ui.label("The studio is open in another tab.")
            ui.button("Use it here", on_click=lambda: ui.navigate.reload()).props("no-caps")

    session.take_over(let_go)
    with ui.element("header").classes("serp-head"):
        ui.label("serp studio").classes("serp-brand")
        state = ui.label().classes("serp-file")
        ui.element("div").classes("serp-space")
        keys = "Ctrl+S: save · Esc, then Tab: leave the text · ← →: move a slider"
        ui.label(keys).classes("serp-faint serp-keys")
        save = ui.button("Save").props('dense flat no-caps title="Ctrl+S"')
    with ui.splitter(value=45, limits=(20, 80)).classes("serp-main") as splitter:
        files = ui.element("section").classes("serp-editor").props('aria-label="Files"')
        files.move(splitter, target_slot="before")
        with files:
            editor = EditorPane(session, live)
        with splitter.after, ui.element("div").classes("serp-right"):
            scene = ScenePane(session, live)
            with ui.element("section").classes("serp-panel"):
                DecisionPane(live, editor.jump)
    save.on_click(lambda: editor.save())

    def show_state(view: View) -> None:
        state.set_text(", ".join(map(_described, session.documents.values())))
        save.set_enabled(session.changed)

    live.shows(show_state)

    client.on_delete(live.close)
    prefers_dark = await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches")
    if live.closed:
        return
    editor.dark(bool(prefers_dark))
    live.begin()
    await scene.begin()


def _described(document: Document) -> str:
    """Return a file's name, whether it was changed, and where it is saved if elsewhere."""
    name = document.path.name + (" •" if document.changed else "")
    if document.elsewhere:
        name += f" (to be saved as {document.target.name} in the working folder)"
    return name


class DecisionPane:
    """Shows decisions; where an error leaves none, the last one stays, faint."""

    def __init__(self, live: Live, jump: Jump) -> None:
        self._root = ui.element("section").classes("serp-decision").props('aria-label="Decision"')
        with self._root:
            self._table = ui.html()
            self._verdict = ui.label().classes("serp-faint").props('role="status"')
            self._graph = ui.html().classes("serp-graph")
            self._graph.props('tabindex="0" role="region" aria-label="Planning graph"')
        follow_places(self._table, jump)
        live.shows(self.show)

    def show(self, view: View) -> None:
        """Show the decision of a view."""
        decision = view.decision
        if decision is None:
            self._root.classes(add="serp-stale")
            if not self._verdict.text:
                self._verdict.set_text("The file has errors, so there is no decision yet.")
            return
        self._root.classes(remove="serp-stale")
        account = decision.account
        table = render(
            "serp.ui.studio.pages",
            "decision.html.j2",
            {"readable": readable, "percent": percent},
            kind=kind_of_return(account.partial),
            shown=decision.shown,
            chosen=account.chosen,
            more=len(account.alternatives) - len(decision.shown),
            runs_of=runs_of,
            line_of_run=line_of_run,
        )
        self._table.set_content(table)
        self._verdict.set_text(decision.verdict)
        self._graph.set_content(decision.graph)
