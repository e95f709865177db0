"""The page of the studio: the files on the left, what they mean on the right."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from serp._util.figures import PALETTE
from serp.ui.studio.document import Document
from serp.ui.studio.pages.decision_pane import DecisionPane
from serp.ui.studio.pages.editor import EditorPane, FindingsPane
from serp.ui.studio.pages.live import Live
from serp.ui.studio.pages.situation import ScenePane
from serp.ui.studio.session import Session
from serp.ui.studio.view import Request, View

_COLOURS = {
    **PALETTE,
    "paper": ("#f6f7f9", "#0f1216"),
    "warn": ("#8a5a00", "#e3b341"),
    "glow": ("#e8f0fa", "#1f2c3d"),
}
"""Name → colour on light and on dark."""


async def show_page(session: Session) -> None:
    """Build the page for a browser that has just called; it takes the studio from an older one."""
    style = Path(__file__).with_name("studio.css").read_text(encoding="utf-8")
    client = ui.context.client
    live = Live(session)

    def let_go() -> None:
        live.close()
        if client.is_deleted:
            return
        client.content.clear()  # what this tab still sends, perhaps after a pause, finds nobody
        with client.content, ui.card().classes("serp-elsewhere"):
            ui.label("The studio is open in another tab.")
            ui.button("Use it here", on_click=lambda: ui.navigate.reload()).props("no-caps")

    owner = session.take_over(let_go)
    ui.add_css(_variables() + style)
    dark = ui.dark_mode()
    with ui.element("header").classes("serp-head"):
        ui.label("serp studio").classes("serp-brand")
        state = ui.label().classes("serp-file")
        ui.element("div").classes("serp-space")
        save = ui.button("Save").props('dense flat no-caps title="Ctrl+S"')
        theme = ui.button("Dark").props("dense flat no-caps")
    with ui.splitter(value=45, limits=(20, 80)).classes("serp-main") as splitter:
        files = ui.element("section").classes("serp-editor").props('aria-label="Files"')
        files.move(splitter, target_slot="before")
        with files:
            editor = EditorPane(session, live)
            FindingsPane(session, live, editor)
        with splitter.after, ui.element("div").classes("serp-right"):
            scene = ScenePane(session, live)
            with ui.element("section").classes("serp-panel"):
                DecisionPane(live, editor.jump)
    save.on_click(lambda: editor.save())

    def show_state(request: Request, view: View) -> None:
        state.set_text(", ".join(map(_described, session.documents.values())))
        save.set_enabled(session.changed)

    live.shows(show_state)

    def set_dark(value: bool) -> None:
        dark.set_value(value)
        editor.dark(value)
        theme.set_text("Light" if value else "Dark")

    theme.on_click(lambda: set_dark(not dark.value))
    client.on_delete(live.close)
    await client.connected()
    if session.owner != owner:
        return
    prefers_dark = await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches")
    if session.owner != owner:
        return
    set_dark(bool(prefers_dark))
    live.begin()
    await scene.begin()


def _described(document: Document) -> str:
    """Return a file's name, whether it was changed, and where it is saved if elsewhere."""
    name = document.path.name + (" •" if document.changed else "")
    if document.elsewhere:
        name += f" (to be saved as {document.target.name} in the working folder)"
    return name


def _variables() -> str:
    """Return the colours as CSS variables, light and dark."""
    return "".join(
        f"{where} {{{''.join(f'--{name}: {both[k]};' for name, both in _COLOURS.items())}}}\n"
        for k, where in enumerate((":root", ".body--dark"))
    )
