"""The pane of scenarios."""

from __future__ import annotations

from html import escape

from nicegui import run, ui

from serp.authoring.scenarios.checking import Result
from serp.errors import SerpError, with_notes
from serp.ui.studio.pages.editor import EditorPane
from serp.ui.studio.pages.live import Live, busy, button
from serp.ui.studio.session import SCENARIOS, Session


class ScenariosPane:
    """The scenarios: run on the text as it is edited, and made of the state that is shown."""

    def __init__(self, session: Session, live: Live, editor: EditorPane) -> None:
        self._session, self._live, self._editor = session, live, editor
        with ui.element("div").classes("serp-row"):
            self._run = button("Run the scenarios", self.run)
            self._title = ui.input(placeholder="title of a new scenario").props("dense")
            self._add = button("Add the state as a scenario", self.add)
        self._summary = ui.label().classes("serp-verdict").props('role="status"')
        self._list = ui.html(tag="ul").classes("serp-results")

    async def run(self) -> None:
        """Run the scenarios on the texts of this moment."""
        request = self._session.request()
        if not request.scenarios.text.strip():
            self._summary.set_text(
                "There are no scenarios yet. Choose a state, write a title, and add it."
            )
            return
        with busy(self._run):
            try:
                results = await run.io_bound(request.run_scenarios)
            except SerpError as error:
                self._summary.set_text(with_notes(error))
                self._list.set_content("")
                return
        failed = sum(not result.passed for result in results)
        passed = f"{len(results) - failed} passed"
        self._summary.set_text(f"{passed}, {failed} failed" if failed else passed)
        self._list.set_content("".join(map(_result, results)))

    async def add(self) -> None:
        """Add the state that is shown, as a scenario of what holds there."""
        title = (self._title.value or "").strip()
        if not title:
            ui.notify("Write a title first.")
            return
        session = self._session
        before = session.documents[SCENARIOS].text
        with busy(self._add):
            try:
                text = await run.io_bound(session.request().with_scenario, title)
            except SerpError as error:
                ui.notify(with_notes(error), type="negative", multi_line=True)
                return
        if self._live.closed:
            return
        if session.documents[SCENARIOS].text != before:
            ui.notify("The scenarios have been changed meanwhile. Add the state once more.")
            return
        session.edit(SCENARIOS, text)
        self._editor.refresh()
        self._editor.reveal(SCENARIOS, text.count("\n") + 1)
        self._title.set_value("")
        self._live.changed()
        await self.run()


def _result(result: Result) -> str:
    mark, kind = ("✓", "serp-passed") if result.passed else ("✗", "serp-failed")
    failures = "".join(
        f"<div>line {failure.line}: <code>{escape(failure.expected)}</code><br>"
        f"{escape(failure.found)}</div>"
        for failure in result.failures
    )
    return f'<li class="{kind}"><b>{mark} {escape(result.scenario.title)}</b>{failures}</li>'
