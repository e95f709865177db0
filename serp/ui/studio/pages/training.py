"""A training in the background, and what arrives of it."""

from __future__ import annotations

from collections.abc import Collection
from html import escape
from typing import Any, Final

from nicegui import run, ui

from serp._util.figures import PALETTE
from serp.errors import SerpError
from serp.ui.studio.session import Session
from serp.ui.studio.training import BackgroundTraining, TrainingProgress

_EVERY: Final = 1.5
"""Seconds between two looks at what was written."""
_SMOOTH: Final = 20
_COLOURS: Final = ("blue", "orange", "green", "vermilion", "purple", "sky")


class TrainingPane:
    """Starts and stops a training, and draws its return, ρ, vetoes and the model's error.

    Args:
        session: What is open.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._colours: dict[str, str] = {}
        with ui.element("div").classes("serp-row"):
            self._begin = ui.button("Train", on_click=self.begin).props("dense outline no-caps")
            self._stop = ui.button("Stop", on_click=self.stop).props("dense outline no-caps")
            self._steps = ui.number("steps", value=20_000, min=100, precision=0).props("dense")
            self._seed = ui.number("seed", value=0, min=0, precision=0).props("dense")
            for number in (self._steps, self._seed):
                number.classes("serp-seed")
        self._summary = ui.label().classes("serp-verdict").props('role="status"')
        with ui.element("div").classes("serp-charts"):
            self._returns = _chart(
                "return of an episode and ρ, over steps", ["return", "mean of 20", "ρ"]
            )
            self._errors = _chart("error of the file, in usual changes, over steps", [])
        self._vetoes = ui.html()
        self._timer = ui.timer(_EVERY, self._look, active=session.training is not None)
        self._stop.set_enabled(session.training is not None)

    def begin(self) -> None:
        """Begin a training on the saved file."""
        running = self._session.training
        if running is not None and running.running:
            ui.notify("A training is running. Stop it first.")
            return
        try:
            steps, seed = int(self._steps.value or 0), int(self._seed.value or 0)
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
        training = self._session.training
        if training is None:
            self._timer.deactivate()
            return
        progress = await run.io_bound(training.progress)
        if progress is not None:
            self._show(training, progress)
            if not progress.running:
                self._timer.deactivate()
                self._stop.set_enabled(False)

    def _show(self, training: BackgroundTraining, progress: TrainingProgress) -> None:
        steps, returns = progress.env_steps, progress.returns
        state = "running" if progress.running else progress.said or "ended"
        done = f"{len(returns)} episodes, {steps[-1]:,} steps" if steps else "no episode yet"
        self._summary.set_text(f"{training.run.name}: {state}; {done}")
        means = [
            sum(returns[max(0, k - _SMOOTH + 1) : k + 1]) / min(k + 1, _SMOOTH)
            for k in range(len(returns))
        ]
        every = max(1, len(steps) // 400)
        for series, values in zip(
            self._returns.options["series"], (returns, means, progress.rho), strict=True
        ):
            series["data"] = [[*pair] for pair in zip(steps, values, strict=True)][::every]
        self._returns.update()
        colours = self._colours_of(progress.errors)
        self._errors.options["series"] = [
            _line(name, colours[name], list(zip(progress.error_steps, values, strict=True)))
            for name, values in progress.errors.items()
        ]
        self._errors.update()
        rows = "".join(
            f'<tr><td class="serp-number">{count:,}</td><td>{escape(reason)}</td></tr>'
            for reason, count in progress.vetoes.items()
        )
        head = "<thead><tr><th>vetoes</th><th>reason</th></tr></thead>"
        self._vetoes.set_content(
            f'<table class="serp-vetoes">{head}<tbody>{rows}</tbody></table>' if rows else ""
        )

    def _colours_of(self, shown: Collection[str]) -> dict[str, str]:
        """Return fluent → colour; who is shown already keeps its own."""
        kept = {name: colour for name, colour in self._colours.items() if name in shown}
        free = [colour for colour in _COLOURS if colour not in kept.values()]
        new = (name for name in shown if name not in kept)
        self._colours = kept | dict(zip(new, free, strict=False))
        return self._colours


def _chart(title: str, names: list[str]) -> Any:
    colours = {"return": "sky", "mean of 20": "blue", "ρ": "orange"}
    faint = PALETTE["line"][0]
    line = {"lineStyle": {"color": faint}}
    axis = {"axisLine": line, "splitLine": {"show": False}, "axisLabel": {"color": faint}}
    return ui.echart(
        {
            "animation": False,
            "title": {
                "left": 0,
                "top": 0,
                "text": title,
                "padding": 0,
                "textStyle": {"fontSize": 13, "fontWeight": "normal", "color": faint},
            },
            "grid": {"left": 46, "right": 46, "top": 80, "bottom": 28},
            "legend": {
                "top": 22,
                "left": 0,
                "padding": [4, 0],
                "itemWidth": 14,
                "itemHeight": 4,
                "icon": "roundRect",
                "textStyle": {"color": faint},
            },
            "tooltip": {"trigger": "axis"},
            "xAxis": {"type": "value", **axis, "axisLine": {"onZero": False, **line}},
            "yAxis": [
                {"type": "value", "scale": True, **axis},
                {"type": "value", "min": 0, "max": 1, "show": "ρ" in names, **axis},
            ],
            "series": [_line(name, colours[name], [], right=name == "ρ") for name in names],
        }
    ).classes("serp-chart")


def _line(name: str, colour: str, data: list[Any], *, right: bool = False) -> dict[str, Any]:
    return {
        "name": name,
        "type": "line",
        "showSymbol": False,
        "yAxisIndex": int(right),
        "lineStyle": {"width": 1 if name == "return" else 2},
        "color": PALETTE[colour][0],
        "data": [list(each) for each in data],
    }
