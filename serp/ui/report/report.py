"""The report of a run: one HTML file that needs nothing else, see docs/how-to/report.md."""

from __future__ import annotations

import base64
import functools
import hashlib
from importlib.resources import files
from pathlib import Path

import numpy as np

from serp._util.figures import page_colours
from serp._util.files import write_durably
from serp._util.terminal import bar, visible
from serp._util.text import percent, plural, readable
from serp.errors import RunError, needs_extra
from serp.runs.recording import ACTORS, Layout
from serp.runs.results import lead, title
from serp.runs.rollout import evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.run_model import RunModel
from serp.runs.summary import WINDOW, summarize
from serp.ui.report import step_data
from serp.ui.report.recorded_steps import curve_arrays, recorded_steps
from serp.ui.report.scene import drawn_scenes
from serp.ui.report.step_accounts import StepAccounts, model_errors, shown_cause

with needs_extra("report", "a report of a run"):
    from markupsafe import Markup

    from serp._util.templates import render


def write_report(
    run: Run, path: Path, *, evaluation: str | None, steps: int, pictures: int
) -> None:
    """Write the report of a run, one HTML document without references to other files.

    `evaluation` is the recorded evaluation whose steps are shown, None those of the training;
    `steps` and `pictures` are the most that the page has (fewer steps of many fluents and actions).
    An existing file is replaced.
    """
    read = RunModel(run.path)
    recording = read.recording(evaluation)
    layout, sources = recording.layout, read.domain.sources
    numbers = 4 * len(layout.fluents) + 6 * len(layout.actions) + 12
    most = max(1, min(steps, 8_000_000 // numbers))
    shown = recorded_steps(recording, most)
    with bar("drawing", max(1, min(pictures, len(shown) + len(shown.episodes)))) as advance:
        seed_of = functools.partial(_seed, run, layout, evaluation)
        scenes = drawn_scenes(run, shown, seed_of, most=pictures, on_picture=advance)
    actions = [visible(name) for name in layout.actions]
    with bar("explaining", max(1, len(shown))) as advance:
        accounts = StepAccounts(read.adapted or read.model, shown, actions, advance)
    errors = model_errors(read.model, shown, recording.usual_change)
    cards = accounts.prevented(sources)
    card = np.zeros(len(shown), np.uint16)
    for number, each in enumerate(cards, 1):
        card[each["steps"]] = number
    arrays, order = step_data.packed(
        {
            **curve_arrays(run.metrics),
            **step_data.step_arrays(shown, errors, accounts),
            "card": card,
            "pictures": np.frombuffer(b"".join(scenes.pictures), np.uint8),
            "pictureAt": np.cumsum([0, *map(len, scenes.pictures)]).astype(np.uint32),
        }
    )
    last = shown.episodes[-1].first if shown.episodes else 0
    actors = [str(actor) for actor in ACTORS]
    meta = {
        "layout": order,
        "steps": len(shown),
        "training": evaluation is None,
        "dt": layout.control_period,
        "envSteps": int(run.metrics["env_steps"].max(initial=1)),
        "actors": actors,
        "actions": actions,
        "fluents": [{"name": visible(each.name), "numeric": each.numeric}
                    for each in read.model.fluents],
        "largeError": errors.limit,
        "episodes": step_data.episode_data(shown, scenes),
        "causes": [shown_cause(cause, sources) for cause in accounts.causes],
        "start": int(np.flatnonzero(shown.vetoed)[-1]) if shown.vetoed.any() else last,
    }  # fmt: skip
    kinds = [
        ("vetoes", step_data.VETOED, "back-vetoed", shown.vetoed),
        ("no safe action", step_data.NO_SAFE, "back-unsafe", shown.no_safe),
        ("observed unsafe", step_data.UNSAFE, "back-unsafe", shown["unsafe"]),
        ("large errors", step_data.LARGE_ERROR, "back-error", errors.large),
    ]
    scripts = ("data", "charts", "scene", "tables", "strip", "replay", "main")
    style = page_colours() + _text("style.css")
    script = "".join(_text(f"{name}.js") for name in scripts)
    summary, made = summarize(run.metrics, run.config), read.folder.metadata
    page = render(
        "serp.ui.report",
        "page.html.j2",
        {"readable": readable, "percent": percent, "visible": visible},
        plural=plural,
        title=visible(title(summary)),
        lead=visible(lead(summary)),
        style=Markup(style),
        script=Markup(script),
        policy={"style": _digest(style), "script": _digest(script)},
        meta=meta,
        arrays=Markup(arrays),
        summary=summary,
        window=WINDOW,
        off=errors.mean,
        evaluation=evaluation,
        prevented=cards,
        steps=len(shown),
        episodes=shown.episodes,
        all_steps=len(recording),
        all_episodes=len(recording.episodes),
        drawn=len(scenes.frames),
        kinds=[(label, bit, swatch, int(of.sum())) for label, bit, swatch, of in kinds],
        acting=[(actor, int((shown["executed_by"] == k).sum())) for k, actor in enumerate(actors)],
        files=[
            (
                visible(Path(source.name).name),
                [visible(source.line_text(n + 1)) for n in range(len(source.line_starts))],
            )
            for source in sources
        ],
        origin=f"{run.path.name}, begun {made['created']}, serp {made['versions'].get('serp')}.",
    )
    write_durably(path, page)


def _text(name: str) -> str:
    return (files("serp.ui.report") / "templates" / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def _seed(run: Run, layout: Layout, evaluation: str | None, episode: int) -> int:
    """Return the seed of an episode, by its number from 0."""
    if evaluation is None:
        return training_seed(run.config["seed"], episode)
    if layout.seed is None:
        raise RunError("the recording does not say which seed it was made with")
    return evaluation_seed(layout.seed, episode)
