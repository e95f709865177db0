"""The panes beside the decision: scenarios, and a training in the background."""

from __future__ import annotations

import contextlib
import json
from html import escape
from pathlib import Path
from typing import Final

from nicegui import run, ui

from serp._util.text import plural
from serp.authoring.scenarios.checking import Result
from serp.errors import RunError, SerpError, with_notes
from serp.runs.folder import METRICS
from serp.runs.tables import read_metrics
from serp.ui import report
from serp.ui.report.recorded_steps import curve_arrays
from serp.ui.studio.pages.editor import EditorPane
from serp.ui.studio.pages.live import Live, busy, button
from serp.ui.studio.session import SCENARIOS, Session

_CHART: Final = """<script>const drawTraining = (() => {%s
  return (run, arrays) => {
    [meta, curves] = [run, arrays];
    if (byId("curve")?.clientWidth) drawCurve(byId("curve"));
  };
})();</script>"""
"""The report's script for its learning curve; out of sight nothing is drawn."""


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
        scenarios = self._session.scenarios
        if not scenarios.source.text.strip():
            self._summary.set_text(
                "There are no scenarios yet. Choose a state, write a title, and add it."
            )
            return
        with busy(self._run):
            try:
                results = await run.io_bound(scenarios.run)
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
                text = await run.io_bound(session.scenarios.with_state, title, session.shown)
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


class TrainingPane:
    """Starts and stops a training, and draws its learning curve as the report does."""

    def __init__(self, session: Session) -> None:
        self._session = session
        folder = Path(report.__file__).with_name("page")
        scripts = [(folder / f"{name}.js").read_text("utf-8") for name in ("data", "charts")]
        ui.add_body_html(_CHART % "".join(scripts))
        with ui.element("div").classes("serp-row"):
            button("Train", self.begin)
            self._stop = button("Stop", self.stop)
            self._steps = ui.number("steps", value=20_000, min=100, precision=0)
            self._seed = ui.number("seed", value=0, min=0, precision=0)
            for number in (self._steps, self._seed):
                number.props("dense").classes("serp-seed")
        self._summary = ui.label().classes("serp-verdict").props('role="status"')
        self._curve = ui.html('<div id="curve" data-label="Learning curve"></div>')
        self._curve.classes("serp-curve")
        self._hint = ui.html('<span id="curve-says"></span>').classes("serp-faint")
        self._timer = ui.timer(1.5, self._look, active=session.training is not None)
        self._stop.set_enabled(session.training is not None)

    def begin(self) -> None:
        """Begin a training on the saved file."""
        running = self._session.training
        if running is not None and running.state == "running":
            ui.notify("A training is running. Stop it first.")
            return
        steps, seed = int(self._steps.value or 0), int(self._seed.value or 0)
        try:
            self._session.begin_training(max(100, steps), max(0, seed))
        except SerpError as error:
            ui.notify(str(error), type="warning", multi_line=True)
            return
        self._summary.set_text("Beginning …")
        self._stop.set_enabled(True)
        self._timer.activate()

    def stop(self) -> None:
        """Let the training finish its episode and save."""
        if self._session.training is not None:
            self._session.training.stop()
            self._summary.set_text("Stopping: the episode is finished and saved.")

    async def _look(self) -> None:
        """Show what has been written so far."""
        training = self._session.training
        assert training is not None
        state = training.state
        done = "no episode yet"
        # Files may not be there yet, or be in the middle of being written.
        with contextlib.suppress(RunError, OSError):
            metrics = await run.io_bound(read_metrics, training.run / METRICS)
            arrays = {name: array.tolist() for name, array in curve_arrays(metrics, ()).items()}
            if steps := arrays["curveAt"]:
                count, rho = plural(len(metrics["return"]), "episode"), arrays["rho"][-1]
                done = f"{count}, {steps[-1]:,} steps, ρ {rho:.2f}"
                data = json.dumps({"envSteps": steps[-1]}), json.dumps(arrays)
                self._curve.client.run_javascript(f"drawTraining({', '.join(data)})")
        self._summary.set_text(f"{training.run.name}: {state}; {done}")
        if state != "running":
            self._timer.deactivate()
            self._stop.set_enabled(False)
