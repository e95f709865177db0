"""What is wrong in the files: underlined in the text, and as a list that leads there."""

from __future__ import annotations

import asyncio
from collections import Counter
from html import escape
from typing import Any, Final

from nicegui import ui

from serp._util.text import plural
from serp.lint.findings import Finding
from serp.studio.pages.editor import EditorPane
from serp.studio.pages.live import Live, Pane
from serp.studio.reading import Version
from serp.studio.session import Request, Session
from serp.studio.view import View

_PAUSE: Final = 0.3
"""Seconds without a change after which places are underlined."""
_MOST: Final = 200
_CLICK: Final = (
    "(e) => { const b = e.target.closest('[data-finding]'); "
    "if (b) emit(b.dataset.what, b.dataset.finding) }"
)


class FindingsPane(Pane):
    """The list of findings; each can be gone to, and mended where it is known how.

    Args:
        session, live: See `Pane`.
        editor: Where the texts are edited.
    """

    def __init__(self, session: Session, live: Live, editor: EditorPane) -> None:
        super().__init__(session, live)
        self._editor = editor
        self._findings: tuple[Finding, ...] = ()
        self._listed: list[str] | None = None
        self._underlined: dict[str, list[tuple[str, int]]] = {}
        self._position = -1
        self._summary = ui.label().classes("serp-summary").props('role="status"')
        self._list = ui.html(tag="ul").classes("serp-findings")
        self._list.on("click", self._clicked, js_handler=_CLICK)
        editor.keys({"F8": lambda: self._next(1), "Shift-F8": lambda: self._next(-1)})
        live.shows(self.show)

    def show(self, request: Request, view: View) -> None:
        """Show what is wrong, in the text and in the list."""
        self._findings = view.findings
        asyncio.get_running_loop().call_later(_PAUSE, self._underline, request.version)
        listed = [finding.rendered for finding in view.findings] + [view.failure]
        if listed == self._listed:
            return
        self._listed, self._position = listed, -1
        counted = Counter(finding.severity for finding in view.findings)
        said = [
            plural(counted[kind], kind) for kind in ("error", "warning", "note") if counted[kind]
        ]
        self._summary.set_text(view.failure or ", ".join(said) or "Nothing is wrong here.")
        self._list.set_content("".join(map(self._item, range(_MOST), view.findings)))
        self._editor.keep_in_sight()

    def _underline(self, version: Version) -> None:
        """Underline the places of findings, unless the text has changed since.

        Not while somebody types: the editor may then put the cursor elsewhere.
        """
        if version != self._session.version:
            return
        for which in self._session.documents:
            placed = [f for f in self._findings if self._session.document_of(f.place) == which]
            marks = [mark for finding in placed if (mark := _mark(finding)) is not None]
            # The editor moves its marks along with their text.
            told = [(mark["attributes"]["title"], mark["to"] - mark["from"]) for mark in marks]
            if told != self._underlined.get(which, []):
                self._editor.underline(which, marks)
                self._underlined[which] = told

    def _item(self, position: int, finding: Finding) -> str:
        place, severity = finding.place, finding.severity
        where = ""
        if place is not None and (which := self._session.document_of(place)) is not None:
            name = self._session.documents[which].path.name
            where = f'<span class="serp-place">{escape(name)}:{place.line}:{place.column}</span> '
        advice = finding.advice and f'<span class="serp-advice">{escape(finding.advice)}</span>'
        mend = ""
        if finding.fix is not None:
            mend = (
                f'<button type="button" class="serp-mend" data-what="mend" '
                f'data-finding="{position}">{"Mend" if finding.fix.sure else "Try this"}</button>'
            )
        return (
            f'<li><button type="button" class="serp-{severity}" data-what="go" '
            f'data-finding="{position}"><span class="serp-kind">{severity}</span> {where}'
            f'{escape(finding.message)} <span class="serp-place">[{escape(finding.code)}]</span>'
            f"{advice}</button>{mend}</li>"
        )

    def _clicked(self, event: Any) -> None:
        what, position = event.args
        if not str(position).isdecimal() or not int(position) < len(self._findings):
            return
        finding = self._findings[int(position)]
        if what == "mend":
            if self._session.mend(finding):
                self._editor.refresh()
                self._live.changed()
        else:
            self._position = int(position)
            self._go(finding)

    def _next(self, step: int) -> None:
        placed = [k for k, finding in enumerate(self._findings) if finding.place is not None]
        if placed:
            at = placed.index(self._position) + step if self._position in placed else 0
            self._position = placed[at % len(placed)]
            self._go(self._findings[self._position])

    def _go(self, finding: Finding) -> None:
        which = self._session.document_of(finding.place)
        if which is not None and finding.place is not None:
            self._editor.reveal(which, finding.place.start, finding.place.line)


def _mark(finding: Finding) -> dict[str, Any] | None:
    """Return how the editor underlines a place: within its first line, at least a character."""
    place = finding.place
    if place is None:
        return None
    text = place.source.text
    line_end = place.start + len(place.source_line) - (place.column - 1)
    end = min(max(place.end, place.start + 1), max(line_end, place.start + 1), len(text))
    if end <= place.start:
        return None
    said = f"{finding.message}\n{finding.advice}".strip()
    return {
        "kind": "mark",
        "from": place.start,
        "to": end,
        "class": f"serp-mark-{finding.severity}",
        "attributes": {"title": said},
    }
