"""The report of a run: one HTML file that needs nothing else, see docs/how-to/report.md."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Final

from serp._util.files import write_durably
from serp._util.terminal import bar, visible
from serp.errors import Notice
from serp.report.causes import CauseTable
from serp.report.curves import planner_baseline
from serp.report.model_errors import model_errors
from serp.report.page import Content, page
from serp.report.recorded_steps import chosen_steps, recorded_episodes
from serp.report.scene import drawn_scenes
from serp.review.run_model import RunModel
from serp.runs.recording import Recording
from serp.runs.recording_format import Layout
from serp.training.rollout import evaluation_seed, training_seed
from serp.training.run import Run

STEPS: Final = 30_000
PICTURES: Final = 4_000
BASELINE: Final = 10
_PICTURE_BYTES: Final = 4_500_000
"""Bytes of pictures beyond which nothing more is drawn; in the page they take a third more."""
_NUMBERS: Final = 8_000_000
"""Most numbers in the page."""


def write_report(
    run: Run,
    path: Path,
    *,
    evaluation: str | None = None,
    steps: int = STEPS,
    pictures: int = PICTURES,
    baseline: int = BASELINE,
    quiet: bool = False,
) -> None:
    """Write the report of a run; an existing file is replaced.

    Args:
        run: The run.
        path: The file.
        evaluation: Name of the recorded evaluation whose steps are shown; None: those of the
            training.
        steps: Most steps in the page; of fluents and actions in great number fewer.
        pictures: Most pictures of the scene; 0 for none.
        baseline: Episodes of the planner alone if no evaluation of it was recorded; 0 for none.
        quiet: Show no progress bar.

    A damaged evaluation, beside the one that is shown, is left out; the page and a `Notice` say so.

    Raises:
        RunError: The run has no recording, or a file cannot be read or written.
        SerpError: Its task cannot be loaded, or its environment failed.
    """
    read = RunModel(run.path)
    recording = read.recording(evaluation)
    episodes = recorded_episodes(recording)
    shown = chosen_steps(recording, episodes, _limit(steps, recording.layout))
    count = min(pictures, len(shown) + len(shown.episodes))
    with bar("drawing", max(1, count), quiet=quiet) as advance:
        scenes = drawn_scenes(
            run,
            shown,
            _seeds(run, recording, evaluation),
            most=pictures,
            most_bytes=_PICTURE_BYTES,
            on_picture=advance,
        )
    compared, notes = planner_baseline(run, baseline)
    for note in notes:
        warnings.warn(visible(note), Notice, stacklevel=2)
    content = Content(
        read=read,
        run=run,
        recording=recording,
        recorded=episodes,
        steps=shown,
        errors=model_errors(read.model, shown, recording.usual_change),
        causes=CauseTable(read.adapted or read.model, shown),
        scenes=scenes,
        baseline=compared,
        notes=notes,
    )
    write_durably(path, page(content))


def _seeds(run: Run, recording: Recording, evaluation: str | None) -> Callable[[int], int] | None:
    """Return number of an episode, from 0 → its seed; None if the seed was not recorded."""
    if evaluation is None:
        return functools.partial(training_seed, run.config["seed"])
    seed = recording.layout.seed
    return None if seed is None else functools.partial(evaluation_seed, seed)


def _limit(steps: int, layout: Layout) -> int:
    """Return how many steps fit with all their numbers."""
    each = 4 * len(layout.fluents) + 6 * len(layout.actions) + 12
    return max(1, min(steps, _NUMBERS // each))
