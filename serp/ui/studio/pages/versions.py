"""Two versions of the file on the same states: where their decisions differ."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any, Final

from nicegui import run, ui

from serp._util.text import plural
from serp.errors import SerpError
from serp.ui.studio.pages.live import Live, Pane, busy
from serp.ui.studio.session import Session
from serp.ui.studio.shown_state import ShownState
from serp.ui.studio.versions import Difference, VersionsCompared, compare_versions

_SAVED: Final = "the file as it is saved"
_OF_RUN: Final = "the file as the run had it"
_MOST: Final = 200
_CLICK: Final = (
    "(e) => { const r = e.target.closest('[data-state]'); if (r) emit(r.dataset.state) }"
)


class VersionsPane(Pane):
    """Compares the text with the saved file, or with another file beside it."""

    def __init__(self, session: Session, live: Live) -> None:
        super().__init__(session, live)
        self._states: list[ShownState] = []
        here = session.documents["domain"].path
        others = sorted(str(path) for path in here.parent.glob("*.pddl") if path != here)
        of_run = [] if session.recorded is None else [_OF_RUN]
        with ui.element("div").classes("serp-row"):
            ui.label("Compare the text with")
            self._other = ui.select([_SAVED, *of_run, *others], value=_SAVED).props(
                "dense options-dense"
            )
            self._compare = ui.button("Compare", on_click=self.compare)
            self._compare.props("dense outline no-caps")
        self._summary = ui.label().classes("serp-verdict").props('role="status"')
        self._table = ui.html()
        self._table.on("click", self._clicked, js_handler=_CLICK)

    async def compare(self) -> None:
        """Compare on the state that is shown and all steps of the episode."""
        session = self._session
        with busy(self._compare):
            try:
                other = session.saved_version
                if self._other.value == _OF_RUN and session.recorded is not None:
                    other = session.recorded.version
                elif self._other.value != _SAVED:
                    other = session.other_version(Path(self._other.value))
                self._states = session.states()
                found = await run.io_bound(
                    compare_versions, other, session.version, session.surroundings, self._states
                )
            except SerpError as error:
                self._summary.set_text(str(error))
                self._table.set_content("")
            else:
                self._show(found)

    def _show(self, found: VersionsCompared) -> None:
        said = f"{plural(found.states, 'state')}: {found.chosen} with another choice"
        said += f", {len(found.differences)} with any difference"
        self._summary.set_text(said)
        rows = "".join(map(self._row, found.differences[:_MOST]))
        head = (
            "<tr><th>state</th><th>before</th><th>worth</th><th>now</th><th>worth</th>"
            "<th>harmful now (+), no longer (−)</th></tr>"
        )
        table = (
            f'<table class="serp-differences"><thead>{head}</thead><tbody>{rows}</tbody></table>'
        )
        self._table.set_content(table if rows else "")

    def _row(self, found: Difference) -> str:
        name = escape(self._states[found.state].origin) if found.state else "shown"
        cells = (found.first or "none", found.values[0], found.second or "none", found.values[1])
        kind = "serp-other" if found.first != found.second else ""
        harms = ", ".join(found.harms).replace("-", "−", 1)
        return (
            f'<tr class="{kind}"><td><button type="button" data-state="{found.state}">'
            f"{name}</button></td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}"
            f"<td>{escape(harms)}</td></tr>"
        )

    def _clicked(self, event: Any) -> None:
        number = str(event.args)
        if not number.isdecimal() or not int(number) < len(self._states):
            return
        state = self._states[int(number)]
        if self._session.recorded is None and int(number):
            self._session.show_step(int(number) - 1)
        else:
            self._session.show(state)
        self._live.changed()
