"""The pane of scenarios."""

from __future__ import annotations

from html import escape

from nicegui import run, ui

from serp.authoring.scenarios.checking import Result
from serp.errors import SerpError, with_notes
from serp.ui.studio.pages.live import busy, button
from serp.ui.studio.session import Session


class ScenariosPane:
    """The scenarios, run on the text as it is edited."""

    def __init__(self, session: Session) -> None:
        self._session = session
        with ui.element("div").classes("serp-row"):
            self._run = button("Run the scenarios", self.run)
        self._summary = ui.label().classes("serp-verdict").props('role="status"')
        self._list = ui.html(tag="ul").classes("serp-results")

    async def run(self) -> None:
        """Run the scenarios on the texts of this moment."""
        request = self._session.request()
        if not request.scenarios.text.strip():
            self._summary.set_text(
                "There are no scenarios yet. Write one in the editor, or save one in serp play."
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


def _result(result: Result) -> str:
    mark, kind = ("✓", "serp-passed") if result.passed else ("✗", "serp-failed")
    failures = "".join(
        f"<div>line {failure.line}: <code>{escape(failure.expected)}</code><br>"
        f"{escape(failure.found)}</div>"
        for failure in result.failures
    )
    return f'<li class="{kind}"><b>{mark} {escape(result.scenario.title)}</b>{failures}</li>'
