"""The editor: the domain and its problem, and saving."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from serp.errors import SerpError
from serp.studio.document import ChangedOnDisk
from serp.studio.pages.live import Live
from serp.studio.session import DOMAIN, SCENARIOS, Session

_LANGUAGE = "Common Lisp"
_THEMES = {False: "githubLight", True: "githubDark"}


class EditorPane:
    """Editors in tabs.

    Args:
        session: What is open.
        live: Follows the session.
    """

    def __init__(self, session: Session, live: Live) -> None:
        self._session = session
        self._live = live
        self._editors: dict[str, ui.codemirror] = {}
        with ui.element("section").classes("serp-files"):
            self._build_editors()

    def _build_editors(self) -> None:
        documents = self._session.documents
        with ui.tabs().props("dense no-caps align=left").classes("serp-tabs") as tabs:
            made = {
                which: ui.tab(which, label=document.path.name)
                for which, document in documents.items()
            }
        self._tabs = tabs
        with ui.tab_panels(tabs, value=DOMAIN, animated=False, keep_alive=True).classes(
            "serp-panels"
        ):
            for which, tab in made.items():
                with ui.tab_panel(tab):
                    self._editors[which] = ui.codemirror(
                        documents[which].text,
                        language=None if which == SCENARIOS else _LANGUAGE,
                        indent="  ",
                        on_change=functools.partial(self._edited, which),
                        keymap={"Mod-s": lambda: self.save()},
                    ).classes("serp-code")

    def dark(self, dark: bool) -> None:
        """Show the text light on dark, or dark on light."""
        for editor in self._editors.values():
            editor.theme = _THEMES[dark]

    def _edited(self, which: str, event: Any) -> None:
        self._session.edit(which, event.value or "")
        self._live.changed()

    def keys(self, keys: Mapping[str, Callable[[], None]]) -> None:
        """Bind keys in the text, such as `F8`."""
        for editor in self._editors.values():
            for key, pressed in keys.items():
                editor.map_key(key, pressed)

    def underline(self, which: str, marks: list[dict[str, Any]]) -> None:
        """Underline places of a document.

        Not by the property `decorations`: with it goes the text of this moment, over what has been
        typed since.
        """
        self._editors[which].run_method("setDecorations", marks)

    # Going there -------------------------------------------------------------------------------

    def jump(self, file: str, line: int, column: int) -> None:
        """Show a line and column of a file, both from 1, if it is open."""
        for which, document in self._session.documents.items():
            lines = document.text.split("\n")
            if document.name == file and 0 < line <= len(lines):
                start = sum(len(each) + 1 for each in lines[: line - 1]) + column - 1
                self.reveal(which, start, line)

    def reveal(self, which: str, start: int, line: int) -> None:
        """Put the cursor before a character of a document and show its line."""
        editor = self._editors[which]
        self._tabs.set_value(which)
        units = len((editor.value or "")[:start].encode("utf-16-le")) // 2  # as the browser counts
        ui.run_javascript(
            f"const e = getElement({editor.id}).editor;"
            f"const at = Math.min({units}, e.state.doc.length);"
            "e.dispatch({selection: {anchor: at}, scrollIntoView: true}); e.focus();"
        )
        editor.reveal_line(line)

    # Saving ------------------------------------------------------------------------------------

    def save(self, *, anyway: bool = False) -> None:
        """Save what was changed; ask where a file was changed by another program."""
        try:
            saved = self._session.save(anyway=anyway)
        except ChangedOnDisk as conflict:
            self._ask(str(conflict))
        except SerpError as error:
            ui.notify(str(error), type="negative", close_button=True, timeout=0)
        else:
            names = ", ".join(map(str, saved))
            ui.notify(f"Saved {names}" if saved else "Nothing to save", position="bottom-left")
        self._live.changed()

    def _ask(self, conflict: str) -> None:
        def choose(action: Callable[[], None]) -> None:
            dialog.close()
            action()

        with ui.dialog() as dialog, ui.card():
            ui.label(conflict)
            with ui.row():
                for text, action in (
                    ("Keep mine, replace the file", lambda: self.save(anyway=True)),
                    ("Take the file's text", self.reload),
                    ("Cancel", lambda: None),
                ):
                    ui.button(text, on_click=functools.partial(choose, action)).props("no-caps")
        dialog.open()

    def reload(self) -> None:
        """Take the texts that are on the disk."""
        try:
            self._session.reload()
        except SerpError as error:
            ui.notify(str(error), type="negative")
        self.refresh()
        self._live.changed()

    def refresh(self) -> None:
        """Show the texts of the session."""
        for which, editor in self._editors.items():
            editor.set_value(self._session.documents[which].text)
