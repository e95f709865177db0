"""The report of a run: one HTML file that needs nothing else, see docs/how-to/report.md."""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from serp._util.figures import PALETTE
from serp._util.files import write_durably
from serp._util.terminal import bar, visible
from serp._util.text import percent, plural, readable
from serp.errors import Notice, needs_extra
from serp.pddl.source import Source
from serp.runs.agreeing import RunModel
from serp.runs.recording import ACTORS, RECORDING, Recording
from serp.runs.report import lead, title
from serp.runs.rollout import evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.summary import WINDOW, summarize
from serp.ui.report import step_data
from serp.ui.report.recorded_steps import (
    RecordedEpisode,
    RecordedSteps,
    chosen_steps,
    curve_arrays,
    planner_baseline,
    recorded_episodes,
)
from serp.ui.report.scene import DrawnScenes, drawn_scenes
from serp.ui.report.step_data import packed
from serp.ui.report.tables import (
    CauseTable,
    ModelErrors,
    error_table,
    model_errors,
    prevented,
)

with needs_extra("report", "a report of a run"):
    from markupsafe import Markup

    from serp._util.templates import render


@dataclass(frozen=True)
class Content:
    """What a page shows.

    Attributes:
        read: The run's files, and its model.
        run: The run.
        recording: The recording of its training, or of an evaluation.
        recorded: All episodes of the recording.
        steps: The steps in the page.
        errors: How well the file predicted them.
        causes: What of the file is behind their actions.
        scenes: The pictures of their episodes.
        baseline: The return of the planner alone; None if it is not known.
        notes: What was left out, and why.
    """

    read: RunModel
    run: Run
    recording: Recording
    recorded: list[RecordedEpisode]
    steps: RecordedSteps
    errors: ModelErrors
    causes: CauseTable
    scenes: DrawnScenes
    baseline: dict[str, Any] | None
    notes: list[str]

    @property
    def evaluation(self) -> str:
        """Name of the evaluation whose steps are shown; empty for the training."""
        name = self.recording.folder.name
        return "" if name == RECORDING else visible(name)

    @functools.cached_property
    def cards(self) -> list[dict[str, Any]]:
        """What vetoes prevented, see `prevented`."""
        return prevented(self.steps, self.causes, self.actions)

    @functools.cached_property
    def actions(self) -> list[str]:
        """Names of the actions."""
        return [visible(name) for name in self.recording.layout.actions]


def page(content: Content) -> str:
    """Return the page, one HTML document without references to other files."""
    scripts = ("data", "charts", "scene", "tables", "strip", "replay", "main")
    summary = summarize(content.run.metrics, content.run.config)
    meta, arrays = _data(content)
    colors = "".join(f"--{name}: light-dark({a}, {b}); " for name, (a, b) in PALETTE.items())
    style = f":root {{ {colors}}}\n" + _text("style.css")
    script = "".join(_text(f"{name}.js") for name in scripts)
    sources = content.read.domain.sources
    return render(
        "serp.ui.report",
        "page.html.j2",
        title=visible(title(summary)),
        lead=visible(lead(summary)),
        style=Markup(style),
        script=Markup(script),
        policy={"style": _digest(style), "script": _digest(script)},
        meta=Markup(_json(meta)),
        arrays=Markup(arrays),
        figures=_figures(content, summary),
        curve={"window": WINDOW} if summary["episodes"] else None,
        baseline=content.baseline,
        notes=[visible(note) for note in content.notes],
        evaluation=content.evaluation,
        prevented=_prevented(content),
        more_prevented=max(0, len(content.cards) - 24),
        errors=error_table(content.errors, content.read.model, content.actions, content.steps),
        steps=len(content.steps),
        steps_note=_steps_note(content),
        files=[_file(number, source) for number, source in enumerate(sources)],
        **_filters(content),
        origin=_origin(content),
    )


def _data(content: Content) -> tuple[dict[str, Any], str]:
    """Return the data of the page: JSON values, and packed arrays."""
    steps, scenes = content.steps, content.scenes
    metrics, model = content.run.metrics, content.read.model
    card = np.zeros(len(steps), np.uint16)
    for number, each in enumerate(content.cards, 1):
        card[each["steps"]] = number
    arrays, order = packed(
        {
            **curve_arrays(metrics, () if content.evaluation else content.recorded),
            **step_data.step_arrays(steps, content.errors, content.causes, scenes.drawn(steps)),
            "card": card,
            **step_data.decision_arrays(steps, content.actions),
            **step_data.picture_arrays(scenes.pictures),
        }
    )
    vetoes = np.flatnonzero(steps.vetoed)
    start = int(vetoes[-1]) if len(vetoes) else steps.rows[-1].start if len(steps) else 0
    sources = content.read.domain.sources
    meta = {
        "layout": order,
        "steps": len(steps),
        "dt": content.recording.layout.control_period,
        "envSteps": int(metrics["env_steps"].max(initial=1)),
        "actors": [str(actor) for actor in ACTORS],
        "actions": content.actions,
        "fluents": [
            {"name": visible(fluent.name), "numeric": fluent.numeric} for fluent in model.fluents
        ],
        "largeError": content.errors.limit,
        "baseline": content.baseline,
        "episodes": step_data.episode_data(steps, scenes),
        "causes": [step_data.shown_cause(cause, sources) for cause in content.causes.causes],
        "start": start,
    }
    return meta, arrays


def _figures(content: Content, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the headline figures, of which the same are in `summary.json`."""
    returns, shares = summary["return"], summary["shares"]
    last = returns["last_20"] if returns["last_20"] is not None else returns["mean"]
    compared = "" if content.baseline is None else (
        f"the planner alone: {readable(content.baseline['mean'])}"
    )  # fmt: skip
    steps, unsafe = summary["env_steps"], summary["unsafe_executed"]
    safety = f"{plural(summary['no_safe_action'], 'step')} without a safe action"
    came = summary["unsafe_observed"]
    if came is not None:
        safety += f", {plural(came, 'step')} observed unsafe"
    acted = [f"{name} {percent(share)}" for name, share in shares.items() if share]
    learner = (shares["learner"] or 0.0) + (shares["exploration"] or 0.0)
    off = content.errors.mean
    return [
        {
            "what": f"Return, last {WINDOW} episodes"
            if returns["last_20"] is not None else "Mean return",
            "value": readable(last),
            "more": compared,
        },
        {"what": "Decisions", "value": f"{steps:,}",
         "more": f"in {plural(summary['episodes'], 'episode')}"},
        {"what": "By the learner", "value": percent(learner) if steps else "–",
         "more": ", ".join(acted)},
        {"what": "Proposals refused", "value": f"{summary['vetoes']:,}",
         "more": f"in {percent(summary['vetoes'] / steps)} of the steps" if steps else ""},
        {"what": "Unsafe actions executed", "value": f"{unsafe:,}",
         "more": safety,
         "bad": unsafe > 0},
        {"what": "The file is off by", "value": "–" if off is None else readable(round(off, 2)),
         "more": "× the usual change of a fluent, one step ahead"},
    ]  # fmt: skip


def _prevented(content: Content) -> list[dict[str, Any]]:
    """Return the cards on what vetoes prevented, with what the file says of it."""
    words = {"reward": "a loss", "unsafe": "unsafe", "risk": "a risk"}
    cards = []
    for card in content.cards[:24]:
        about = {"says": f"vetoes of {card['what']}"}
        if card["cause"] >= 0:
            cause = content.causes.causes[card["cause"]]
            about |= step_data.shown_cause(cause, content.read.domain.sources)
            by = "" if cause.origin == "action" else f" by {about['by']}"
            what = words.get(cause.what, about["label"])
            about["what"] = f"{card['what']}: {what}{by}"
        cards.append(card | about)
    return cards


def _steps_note(content: Content) -> str:
    steps, all_steps = len(content.steps), len(content.recording)
    episodes = plural(len(content.steps.episodes), "episode")
    note = f"{plural(steps, 'recorded step')} of {episodes}."
    if steps < all_steps:
        note = (
            f"{steps:,} of {plural(all_steps, 'recorded step')}, {episodes} of "
            f"{len(content.recorded):,}: the last, the best and the worst one, those without a "
            "safe action and those with vetoes first. --steps shows more."
        )
    drawn = len(content.scenes.frames)
    if drawn:
        note += f" The scene is drawn for {plural(drawn, 'episode')}."
    return f"{note} ? shows the keys."


def _filters(content: Content) -> dict[str, Any]:
    """Return the filters and the episodes to choose from."""
    steps = content.steps
    large = content.errors.largest >= content.errors.limit
    kinds = [
        ("vetoes", step_data.VETOED, "back-vetoed", steps.vetoed),
        ("no safe action", step_data.NO_SAFE, "back-unsafe", steps.no_safe),
        ("observed unsafe", step_data.UNSAFE, "back-unsafe", steps["unsafe"]),
        ("large errors", step_data.LARGE_ERROR, "back-error", large),
        ("drawn", step_data.DRAWN, "back-drawn", content.scenes.drawn(steps)),
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


def _file(number: int, source: Source) -> dict[str, Any]:
    """Return a file as lines, code and comment apart."""
    lines = []
    count = len(source.line_starts) - source.text.endswith("\n")
    for line in range(1, count + 1):
        code, mark, comment = source.line_text(line).partition(";")
        lines.append({"id": f"f{number}-{line}", "code": visible(code),
                      "comment": visible(mark + comment)})  # fmt: skip
    return {"name": visible(source.name.rpartition("/")[2]), "lines": lines}


def _origin(content: Content) -> str:
    metadata = content.read.folder.metadata
    version = metadata["versions"].get("serp")
    return visible(f"{content.run.path.name}, begun {metadata['created']}, serp {version}.")


def _json(value: Any) -> str:
    """Return JSON that can stand in a script element."""
    html = str.maketrans({"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"})
    return json.dumps(value, ensure_ascii=False, allow_nan=False).translate(html)


def _text(name: str) -> str:
    return (files("serp.ui.report") / "templates" / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def write_report(
    run: Run,
    path: Path,
    *,
    evaluation: str | None = None,
    steps: int = 30_000,
    pictures: int = 1_000,
    quiet: bool = False,
) -> None:
    """Write the report of a run; an existing file is replaced.

    A damaged evaluation, beside the one that is shown, is left out; the page and a `Notice` say so.

    Args:
        run: The run.
        path: The file.
        evaluation: Name of the recorded evaluation whose steps are shown; None: those of the
            training.
        steps: Most steps in the page; fewer where there are many fluents and actions.
        pictures: Most pictures of the scene; 0 for none.
        quiet: Show no progress bar.

    Raises:
        RunError: The run has no recording, or a file cannot be read or written.
        SerpError: Its task cannot be loaded, or its environment failed.
    """
    read = RunModel(run.path)
    recording = read.recording(evaluation)
    episodes = recorded_episodes(recording)
    numbers = 4 * len(recording.layout.fluents) + 6 * len(recording.layout.actions) + 12
    shown = chosen_steps(recording, episodes, max(1, min(steps, 8_000_000 // numbers)))
    count = min(pictures, len(shown) + len(shown.episodes))
    with bar("drawing", max(1, count), quiet=quiet) as advance:
        seeds = _seeds(run, recording, evaluation)
        scenes = drawn_scenes(run, shown, seeds, most=pictures, on_picture=advance)
    with bar("explaining", max(1, len(shown)), quiet=quiet) as advance:
        causes = CauseTable(read.adapted or read.model, shown, advance)
    baseline, notes = planner_baseline(run)
    for note in notes:
        warnings.warn(visible(note), Notice, stacklevel=2)
    content = Content(
        read=read,
        run=run,
        recording=recording,
        recorded=episodes,
        steps=shown,
        errors=model_errors(read.model, shown, recording.usual_change),
        causes=causes,
        scenes=scenes,
        baseline=baseline,
        notes=notes,
    )
    write_durably(path, page(content))


def _seeds(run: Run, recording: Recording, evaluation: str | None) -> Callable[[int], int] | None:
    """Return number of an episode, from 0 → its seed; None if the seed was not recorded."""
    if evaluation is None:
        return functools.partial(training_seed, run.config["seed"])
    seed = recording.layout.seed
    return None if seed is None else functools.partial(evaluation_seed, seed)
