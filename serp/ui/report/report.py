"""The report of a run: one HTML file that needs nothing else, see docs/how-to/report.md."""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.figures import page_colours
from serp._util.files import write_durably
from serp._util.terminal import bar, visible
from serp._util.text import duration, percent, plural, readable
from serp.errors import RunError, needs_extra
from serp.planning.forecast import SAFE
from serp.runs.recording import ACTORS, Layout
from serp.runs.results import lead, return_of, title
from serp.runs.rollout import evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.summary import WINDOW, moving_mean, summarize
from serp.ui.report.recorded_steps import (
    RecordedEpisode,
    RecordedSteps,
    curve_arrays,
    recorded_steps,
)
from serp.ui.report.scene import DrawnScenes, drawn_scenes
from serp.ui.report.step_accounts import ModelErrors, StepAccounts, model_errors, shown_cause

with needs_extra("report", "a report of a run"):
    from markupsafe import Markup

    from serp._util.templates import render


FIRST_STEPS: Final = 1_000
"""Most steps of the page that is written first."""


def write_report(
    run: Run, path: Path, *, evaluation: str | None, steps: int, pictures: int,
    others: Sequence[Run] = (), on_first: Callable[[], None] = lambda: None,
) -> None:  # fmt: skip
    """Write the report of a run, one HTML document without references to other files.

    `evaluation` is the recorded evaluation whose steps are shown, None those of the training;
    `steps` and `pictures` are the most that the page has (fewer steps of many fluents and actions).
    The mean returns of the `others` are drawn over those of the run. A page of `FIRST_STEPS` steps
    without pictures is written first, and `on_first` called; the whole one replaces it. An existing
    file is replaced.
    """
    _write(run, path, others, evaluation, min(steps, FIRST_STEPS), 0, first=True)
    on_first()
    _write(run, path, others, evaluation, steps, pictures)


def _write(
    run: Run, path: Path, others: Sequence[Run], evaluation: str | None, steps: int, pictures: int,
    *, first: bool = False,
) -> None:  # fmt: skip
    """Write one version of the page."""
    curves = dict[str, NDArray[Any]]()
    for k, other in enumerate(others):
        at, returns = other.metrics["env_steps"], other.metrics["return"]
        if other.domain.name != run.domain.name or not len(returns):
            what = f"{other.domain.name}, {plural(len(returns), 'episode')}"
            raise RunError(
                f"{other.path} ({what}) cannot be drawn with {run.domain.name}'s returns"
            )
        rows = np.unique(np.linspace(0, len(at) - 1, 500).astype(np.int64))
        curves |= {f"otherAt{k}": at[rows], f"otherMean{k}": moving_mean(returns)[rows]}
    recording = run.recording(evaluation)
    layout, sources = recording.layout, run.domain.sources
    numbers = 4 * len(layout.fluents) + 6 * len(layout.actions) + 12
    most = max(1, min(steps, 8_000_000 // numbers))
    shown = recorded_steps(recording, most)
    with bar("drawing", max(1, min(pictures, len(shown) + len(shown.episodes)))) as advance:
        seed_of = functools.partial(_seed, run, layout, evaluation)
        scenes = drawn_scenes(run, shown, seed_of, most=pictures, on_picture=advance)
    actions = [visible(name) for name in layout.actions]
    with bar("explaining", max(1, len(shown))) as advance:
        accounts = StepAccounts(run.adapted or run.model, shown, actions, advance)
    errors = model_errors(run.model, shown, recording.usual_change)
    cards = accounts.prevented(sources)
    card = np.zeros(len(shown), np.uint16)
    for number, each in enumerate(cards, 1):
        card[each["steps"]] = number
    kinds = [  # in the order of their bits
        ("vetoes", "back-vetoed", shown.vetoed),
        ("no safe action", "back-unsafe", shown.no_safe),
        ("observed unsafe", "back-unsafe", shown["unsafe"]),
        ("large errors", "back-error", errors.large),
    ]
    bits = np.array([1, 2, 4, 8], np.uint8) @ np.stack([of for _, _, of in kinds])
    arrays, order = _packed(
        {
            **curve_arrays(run.metrics),
            **curves,
            **_step_arrays(shown, errors, accounts),
            "bits": bits,
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
        "envSteps": int(max(each.metrics["env_steps"].max(initial=1) for each in (run, *others))),
        "others": [visible(str(each.path)) for each in others],
        "actors": actors,
        "actions": actions,
        "fluents": [{"name": visible(each.name), "numeric": each.numeric}
                    for each in run.model.fluents],
        "largeError": errors.limit,
        "episodes": [_episode(each, scenes) for each in shown.episodes],
        "causes": [shown_cause(cause, sources) for cause in accounts.causes],
        "start": int(np.flatnonzero(shown.vetoed)[-1]) if shown.vetoed.any() else last,
    }  # fmt: skip
    scripts = ("data", "charts", "scene", "tables", "strip", "replay", "main")
    style = page_colours() + _text("style.css")
    script = "".join(_text(f"{name}.js") for name in scripts)
    summary, made = summarize(run.metrics, run.config), run.metadata
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
        returned=return_of(summary),
        lasted=duration(summary["wall_time"]),
        curves=[visible(str(each.path)) for each in (run, *others)],
        first=first,
        window=WINDOW,
        off=errors.mean,
        evaluation=evaluation,
        prevented=cards,
        steps=len(shown),
        episodes=shown.episodes,
        all_steps=len(recording),
        all_episodes=len(recording.episodes),
        drawn=len(scenes.frames),
        kinds=[(label, swatch, int(of.sum())) for label, swatch, of in kinds],
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
        raise RunError("the recording does not give its seed")
    return evaluation_seed(layout.seed, episode)


def _packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[str, list[tuple[str, str, int]]]:
    """Return arrays as text, and name, kind (`u1`, `u2`, `u4`, `f4`) and count of each.

    Unsigned integers of 1, 2 or 4 bytes are kept exactly; all other numbers become float32 with at
    least four significant digits, which pack better. Their bytes are little-endian.
    """
    # Bits of a float32 that are retained: 15 of 23 after the binary point, more than four digits.
    retained = np.uint32(0xFFFFFF00)
    layout = []
    parts = []
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).ravel()
        if flat.dtype.kind != "u" or flat.dtype.itemsize > 4:
            with np.errstate(over="ignore"):  # beyond the range of float32 it is infinite
                flat = flat.astype(np.float32)
            half = np.where(np.isfinite(flat), np.uint32(0x80), np.uint32(0))
            flat = ((flat.view(np.uint32) + half) & retained).view(np.float32)
        little = flat.astype(flat.dtype.newbyteorder("<"))
        layout.append((name, f"{little.dtype.kind}{little.itemsize}", len(little)))
        parts.append(little.tobytes())
    # mtime=0: equal data give equal bytes
    return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode("ascii"), layout


def _step_arrays(
    steps: RecordedSteps, errors: ModelErrors, accounts: StepAccounts
) -> dict[str, NDArray[Any]]:
    """Return what is shown of steps, fluents `[F, N]`, alternatives `[A, N]` and causes."""
    none = 0xFFFF
    # 128: the model does not know the action.
    flags = (steps["flags"] & 0xFF) | (128 * (steps["ground"] < 0))
    ends = [episode.rows.stop - 1 for episode in steps.episodes]
    safe = steps["safe_steps"]
    safe = np.where(safe == SAFE, 0xFFFE, np.where(safe < 0, none, np.minimum(safe, 60_000)))
    return {
        "position": steps.positions.astype(np.uint32),
        "executed": steps["action"].astype(np.uint16),
        "proposed": np.where(steps["proposed"] < 0, none, steps["proposed"]).astype(np.uint16),
        "executedBy": steps["executed_by"],
        "reason": steps["reason"],
        "state": steps["state"].T,
        "last": steps["next_state"][ends].T,
        "predicted": errors.predicted.T,
        "errors": errors.errors.T,
        "value": steps["value"].T,
        "reward": steps["reward"].T,
        "risk": steps["path_risk"].T,
        "safe": safe.T.astype(np.uint16),
        "flags": flags.T.astype(np.uint8),
        "causeAt": accounts.at,
        "causeAction": accounts.action,
        "cause": accounts.cause,
        "amount": accounts.amount,
        "sentence": accounts.sentence,
        "sentences": np.frombuffer("\n".join(accounts.sentences).encode(), np.uint8),
    }


def _episode(episode: RecordedEpisode, scenes: DrawnScenes) -> dict[str, Any]:
    """Return an episode as JSON values."""
    frame, frames = scenes.frames.get(episode.number, (0, 0))
    return {
        "number": episode.number,
        "first": episode.first,
        "steps": len(episode),
        "return": episode.return_,
        "end": episode.end,
        "vetoes": episode.vetoes,
        "frame": frame,
        "frames": frames,
        "note": scenes.notes.get(episode.number, ""),
    }
