"""The editor: the domain and its problem, saving, and what is wrong.

The text is what the browser shows; what is typed comes from there as changes of it. Nothing here
sets the text of an editor, nor any of its properties: with them NiceGUI sends the text that it
knows, over what has been typed since.
"""

from __future__ import annotations

import asyncio
import functools
from collections import Counter
from typing import Any, Final

from nicegui import ui

from serp._util.templates import render
from serp._util.text import plural
from serp.authoring.lint.findings import Finding
from serp.errors import SerpError
from serp.ui.studio.pages.live import Live, follow_places
from serp.ui.studio.session import DOMAIN, Session
from serp.ui.studio.view import Version, View

_REVEAL: Final = """((id, number, column) => {
  const editor = getElement(id).editor, doc = editor.state.doc;
  const line = doc.line(Math.min(number, doc.lines));
  const anchor = Math.min(line.from + column - 1, line.to);
  editor.dispatch({selection: {anchor}, scrollIntoView: true});
  editor.focus();
})"""


class EditorPane:
    """Editors in tabs, and the list of findings; each can be gone to."""

    def __init__(self, session: Session, live: Live) -> None:
        self._session, self._live = session, live
        self._editors: dict[str, ui.codemirror] = {}
        self._findings: tuple[Finding, ...] = ()
        self._underlined: dict[str, list[tuple[str, int]]] = {}
        documents = session.documents
        with ui.element("section").classes("serp-files"):
            self._tabs = ui.tabs().props("dense no-caps align=left breakpoint=0")
            with self._tabs.classes("serp-tabs"):
                for which, document in documents.items():
                    ui.tab(which, label=document.path.name)
            self._tabs.set_value(DOMAIN)
            # Not panels of the tabs: an editor that was never shown could not be changed.
            for which in documents:
                with ui.element("div").classes("serp-document") as panel:
                    self._editors[which] = ui.codemirror(
                        documents[which].text,
                        language="Common Lisp",
                        indent="  ",
                        line_wrapping=True,  # a comment is read to its end
                        on_change=functools.partial(self._edited, which),
                        keymap={"Mod-s": lambda: self.save()},
                    ).classes("serp-code")
                panel.bind_visibility_from(self._tabs, "value", value=which)
        self._summary = ui.label().classes("serp-summary").props('role="status"')
        self._list = ui.html(tag="ul").classes("serp-findings")
        follow_places(self._list, self.jump)
        live.shows(self.show)

    def dark(self, dark: bool) -> None:
        """Show the text light on dark, or dark on light."""
        for editor in self._editors.values():
            editor.run_method("setTheme", "githubDark" if dark else "githubLight")

    def _edited(self, which: str, event: Any) -> None:
        self._session.edit(which, event.value or "")
        self._live.changed()

    def jump(self, file: str, line: int, column: int) -> None:
        """Put the cursor at a line and column, both from 1, of a file that is open."""
        for which, document in self._session.documents.items():
            if str(document.path) == file and line > 0:
                editor = self._editors[which]
                self._tabs.set_value(which)
                editor.client.run_javascript(f"{_REVEAL}({editor.id}, {line}, {column})")
                editor.reveal_line(line)

    # Saving ------------------------------------------------------------------------------------

    def save(self) -> None:
        """Save what was changed; where another program has changed a file, the second time."""
        try:
            saved = self._session.save()
        except SerpError as error:
            ui.notify(str(error), type="negative", close_button=True, timeout=0)
        else:
            names = ", ".join(map(str, saved))
            ui.notify(f"Saved {names}" if saved else "Nothing to save", position="bottom-left")
        self._live.changed()

    # Findings ----------------------------------------------------------------------------------

    def show(self, view: View) -> None:
        """Show what is wrong, in the text and in the list."""
        self._findings = view.findings
        asyncio.get_running_loop().call_later(0.3, self._underline, view.version)
        counted = Counter(sorted(finding.severity for finding in view.findings))
        counts = ", ".join(plural(count, kind) for kind, count in counted.items())
        self._summary.set_text(view.failure or counts or "Nothing is wrong here.")
        names = {str(each.path): each.path.name for each in self._session.documents.values()}
        template = ("serp.ui.studio.pages", "findings.html.j2")
        self._list.set_content(render(*template, findings=view.findings[:200], names=names))

    def _underline(self, version: Version) -> None:
        """Underline the places of findings, unless the text has changed since.

        Not while somebody types: the editor may then put the cursor elsewhere.
        """
        if version != self._session.version:
            return
        for which, document in self._session.documents.items():
            made = [_mark(finding, str(document.path)) for finding in self._findings]
            marks = [mark for mark in made if mark is not None]
            # The editor moves its marks along with their text.
            texts = [(mark["attributes"]["title"], mark["to"] - mark["from"]) for mark in marks]
            if texts != self._underlined.get(which, []):
                self._editors[which].run_method("setDecorations", marks)
                self._underlined[which] = texts


def _mark(finding: Finding, file: str) -> dict[str, Any] | None:
    """Return how the editor of a file underlines a place, within its first line."""
    place = finding.place and finding.place.first_line
    if place is None or place.source.name != file or place.end <= place.start:
        return None
    return {
        "kind": "mark",
        "from": place.start,
        "to": place.end,
        "class": f"serp-mark-{finding.severity}",
        "attributes": {"title": f"{finding.message}\n{finding.advice}".strip()},
    }
