"""The report of a run: one HTML file that needs nothing else, see docs/how-to/report.md."""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from serp._util.figures import PALETTE
from serp._util.files import write_durably
from serp._util.terminal import bar, visible
from serp._util.text import percent, plural, readable
from serp.errors import needs_extra
from serp.runs.recording import ACTORS, RECORDING, Recording
from serp.runs.results import lead, title
from serp.runs.rollout import evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.summary import WINDOW, summarize
from serp.ui.report import step_data
from serp.ui.report.recorded_steps import chosen_steps, curve_arrays, recorded_episodes
from serp.ui.report.scene import drawn_scenes
from serp.ui.report.tables import CauseTable, model_errors, prevented

with needs_extra("report", "a report of a run"):
    from markupsafe import Markup

    from serp._util.templates import render


class _Page:
    """The page of a run; see `write_report`."""

    def __init__(self, run: Run, *, evaluation: str | None, steps: int, pictures: int) -> None:
        self.run = run
        self.recording = recording = self.run.recording(evaluation)
        self.recorded = recorded_episodes(recording)
        numbers = 4 * len(recording.layout.fluents) + 6 * len(recording.layout.actions) + 12
        most = max(1, min(steps, 8_000_000 // numbers))
        self.steps = shown = chosen_steps(recording, self.recorded, most)
        count = min(pictures, len(shown) + len(shown.episodes))
        with bar("drawing", max(1, count), quiet=False) as advance:
            seeds = _seeds(run, recording, evaluation)
            self.scenes = drawn_scenes(run, shown, seeds, most=pictures, on_picture=advance)
        model = self.run.model
        with bar("explaining", max(1, len(shown)), quiet=False) as advance:
            self.causes = CauseTable(self.run.adapted or model, shown, advance)
        self.errors = model_errors(model, shown, recording.usual_change)
        self.actions = [visible(name) for name in recording.layout.actions]
        self.cards = prevented(shown, self.causes, self.actions)
        name = recording.folder.name
        self.evaluation = "" if name == RECORDING else visible(name)

    def render(self) -> str:
        """Return the page, one HTML document without references to other files."""
        scripts = ("data", "charts", "scene", "tables", "strip", "replay", "main")
        summary = summarize(self.run.metrics, self.run.config)
        meta, arrays = self._data()
        colors = "".join(f"--{name}: light-dark({a}, {b}); " for name, (a, b) in PALETTE.items())
        style = f":root {{ {colors}}}\n" + _text("style.css")
        script = "".join(_text(f"{name}.js") for name in scripts)
        sources, made = self.run.domain.sources, self.run.metadata
        version = made["versions"].get("serp")
        return render(
            "serp.ui.report",
            "page.html.j2",
            title=visible(title(summary)),
            lead=visible(lead(summary)),
            style=Markup(style),
            script=Markup(script),
            policy={"style": _digest(style), "script": _digest(script)},
            meta=meta,
            arrays=Markup(arrays),
            figures=self._figures(summary),
            curve={"window": WINDOW} if summary["episodes"] else None,
            evaluation=self.evaluation,
            prevented=self._prevented(),
            more_prevented=max(0, len(self.cards) - 24),
            steps=len(self.steps),
            steps_note=self._steps_note(),
            files=[
                (
                    visible(Path(source.name).name),
                    [visible(source.line_text(n + 1)) for n in range(len(source.line_starts))],
                )
                for source in sources
            ],
            **self._filters(),
            origin=visible(f"{self.run.path.name}, begun {made['created']}, serp {version}."),
        )

    def _data(self) -> tuple[dict[str, Any], str]:
        """Return the data of the page: JSON values, and packed arrays."""
        steps, scenes = self.steps, self.scenes
        metrics, model = self.run.metrics, self.run.model
        card = np.zeros(len(steps), np.uint16)
        for number, each in enumerate(self.cards, 1):
            card[each["steps"]] = number
        arrays, order = step_data.packed(
            {
                **curve_arrays(metrics, () if self.evaluation else self.recorded),
                **step_data.step_arrays(steps, self.errors, self.causes, scenes.drawn(steps)),
                "card": card,
                **step_data.decision_arrays(steps, self.actions),
                **step_data.picture_arrays(scenes.pictures),
            }
        )
        vetoes = np.flatnonzero(steps.vetoed)
        start = int(vetoes[-1]) if len(vetoes) else steps.rows[-1].start if len(steps) else 0
        sources = self.run.domain.sources
        meta = {
            "layout": order,
            "steps": len(steps),
            "dt": self.recording.layout.control_period,
            "envSteps": int(metrics["env_steps"].max(initial=1)),
            "actors": [str(actor) for actor in ACTORS],
            "actions": self.actions,
            "fluents": [
                {"name": visible(fluent.name), "numeric": fluent.numeric}
                for fluent in model.fluents
            ],
            "largeError": self.errors.limit,
            "episodes": step_data.episode_data(steps, scenes),
            "causes": [step_data.shown_cause(cause, sources) for cause in self.causes.causes],
            "start": start,
        }
        return meta, arrays

    def _figures(self, summary: dict[str, Any]) -> list[tuple[str, str, str, bool]]:
        """Return the headline figures of `summary.json`: name, value, more, whether it is bad."""
        returns, shares, steps = summary["return"], summary["shares"], summary["env_steps"]
        acted = ", ".join(f"{name} {percent(share)}" for name, share in shares.items() if share)
        unsafe, came = summary["unsafe_executed"], summary["unsafe_observed"]
        recent, off = returns["last_20"] is not None, self.errors.mean
        learner = (shares["learner"] or 0.0) + (shares["exploration"] or 0.0)
        safety = f"{plural(summary['no_safe_action'], 'step')} without a safe action"
        safety += f", {plural(came, 'step')} observed unsafe" if came is not None else ""
        return [
            (f"Return, last {WINDOW} episodes" if recent else "Mean return",
             readable(returns["last_20"] if recent else returns["mean"]), "", False),
            ("Decisions", f"{steps:,}", f"in {plural(summary['episodes'], 'episode')}", False),
            ("By the learner", percent(learner) if steps else "–", acted, False),
            ("Proposals refused", f"{summary['vetoes']:,}",
             f"in {percent(summary['vetoes'] / steps)} of the steps" if steps else "", False),
            ("Unsafe actions executed", f"{unsafe:,}", safety, unsafe > 0),
            ("The file is off by", "–" if off is None else readable(round(off, 2)),
             "× the usual change of a fluent, one step ahead", False),
        ]  # fmt: skip

    def _prevented(self) -> list[dict[str, Any]]:
        """Return the cards on what vetoes prevented, with what the file says of it."""
        words = {"reward": "a loss", "unsafe": "unsafe", "risk": "a risk"}
        cards = []
        for card in self.cards[:24]:
            about = {"says": f"vetoes of {card['what']}"}
            if card["cause"] >= 0:
                cause = self.causes.causes[card["cause"]]
                about |= step_data.shown_cause(cause, self.run.domain.sources)
                by = "" if cause.origin == "action" else f" by {about['by']}"
                what = words.get(cause.what, about["label"])
                about["what"] = f"{card['what']}: {what}{by}"
            cards.append(card | about)
        return cards

    def _steps_note(self) -> str:
        steps, all_steps = len(self.steps), len(self.recording)
        episodes = plural(len(self.steps.episodes), "episode")
        note = f"{plural(steps, 'recorded step')} of {episodes}."
        if steps < all_steps:
            note = (
                f"{steps:,} of {plural(all_steps, 'recorded step')}, {episodes} of "
                f"{len(self.recorded):,}: the last, the best and the worst one, those without a "
                "safe action and those with vetoes first. --steps shows more."
            )
        drawn = len(self.scenes.frames)
        if drawn:
            note += f" The scene is drawn for {plural(drawn, 'episode')}."
        return f"{note} ? shows the keys."

    def _filters(self) -> dict[str, Any]:
        """Return the filters and the episodes to choose from."""
        steps = self.steps
        large = self.errors.largest >= self.errors.limit
        kinds = [
            ("vetoes", step_data.VETOED, "back-vetoed", steps.vetoed),
            ("no safe action", step_data.NO_SAFE, "back-unsafe", steps.no_safe),
            ("observed unsafe", step_data.UNSAFE, "back-unsafe", steps["unsafe"]),
            ("large errors", step_data.LARGE_ERROR, "back-error", large),
            ("drawn", step_data.DRAWN, "back-drawn", self.scenes.drawn(steps)),
        ]
        by = np.bincount(steps["executed_by"], minlength=len(ACTORS))
        return {
            "kinds": [
                {"label": label, "bit": bit, "swatch": swatch, "count": f"{int(of.sum()):,}"}
                for label, bit, swatch, of in kinds
                if of.any()
            ],
            "actors": [str(actor) for actor in ACTORS],
            "acting": [
                {"number": number, "name": str(ACTORS[number]), "count": f"{count:,}"}
                for number, count in enumerate(by.tolist())
                if count
            ],
            "last_episode": max((each.number for each in steps.episodes), default=1),
        }


def _text(name: str) -> str:
    return (files("serp.ui.report") / "templates" / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def _seeds(run: Run, recording: Recording, evaluation: str | None) -> Callable[[int], int] | None:
    """Return number of an episode, from 0 → its seed; None if the seed was not recorded."""
    if evaluation is None:
        return functools.partial(training_seed, run.config["seed"])
    seed = recording.layout.seed
    return None if seed is None else functools.partial(evaluation_seed, seed)


def write_report(
    run: Run, path: Path, *, evaluation: str | None, steps: int, pictures: int
) -> None:
    """Write the report of a run; an existing file is replaced.

    `evaluation` is the recorded evaluation whose steps are shown, None those of the training;
    `steps` and `pictures` are the most that the page has (fewer steps of many fluents and actions).
    """
    page = _Page(run, evaluation=evaluation, steps=steps, pictures=pictures)
    write_durably(path, page.render())
