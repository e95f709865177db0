"""Situations that were recorded in runs."""

from __future__ import annotations

import functools
from pathlib import Path

from serp.runs.recording import Recording, StoredStep, open_recording
from serp.scenarios.syntax import StepOfRun

_opened = functools.lru_cache(4)(open_recording)


def recorded_step(run: Path, step: int, episode: int | None) -> tuple[Recording, StoredStep]:
    """Return a step of a run, and the recording that holds it.

    Args:
        run: The folder of the run.
        step: Its position in the run, from 0, or with `episode` in the episode, from 1.
        episode: Number of the episode, from 1.

    Raises:
        RunError: There is no such run, recording or step.
    """
    recording = _opened(run)
    position = step if episode is None else recording.find(episode, step)
    return recording, recording.step(position)


def recorded_values(of: StepOfRun) -> dict[str, float]:
    """Return fluent → value of a step that a scenario names.

    Raises:
        RunError: There is no such run, recording or step.
    """
    recording, found = recorded_step(Path(of.run), of.step, of.episode)
    return dict(zip(recording.layout.fluents, found.state.tolist(), strict=True))
