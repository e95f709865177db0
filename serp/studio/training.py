"""A training in the background: a process of its own, and what it has written so far."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import RunError
from serp.model.transition_model import TransitionModel
from serp.runs.folder import METRICS
from serp.runs.reading import read_metrics
from serp.runs.recording import Recording, open_recording
from serp.studio.recorded import vetoed

_WINDOWS: Final = 40
_MOST_FLUENTS: Final = 6
_LAST_LINES: Final = 40


@dataclass(frozen=True)
class TrainingProgress:
    """What a training has written so far.

    Attributes:
        running: Whether it goes on.
        env_steps: `[N]` steps in the environment at the end of each episode.
        returns: `[N]` the environment's.
        rho: `[N]` learner probability.
        vetoes: Reason → number of proposals that were refused for it.
        error_steps: `[W]` where the windows of `errors` end, in steps.
        errors: Fluent → `[W]` error of the file's model one step ahead (root mean square), in
            units of the fluent's usual change; those with the largest.
        said: What the process said last, if it failed.
    """

    running: bool
    env_steps: list[int] = field(default_factory=list)
    returns: list[float] = field(default_factory=list)
    rho: list[float] = field(default_factory=list)
    vetoes: dict[str, int] = field(default_factory=dict)
    error_steps: list[int] = field(default_factory=list)
    errors: dict[str, list[float]] = field(default_factory=dict)
    said: str = ""


class BackgroundTraining:
    """A training in a process of its own.

    Args:
        command: Arguments of `serp`, without `--out`.
        run: Folder of the run.
        model: The file's model, by which errors are measured; None: they are not.
    """

    def __init__(self, command: Sequence[str], run: Path, model: TransitionModel | None) -> None:
        self.run = run
        self._model = model
        self._words: deque[str] = deque(maxlen=_LAST_LINES)
        self._process = subprocess.Popen(
            # -P: what lies in the working folder is not imported in place of what is installed.
            [sys.executable, "-P", "-m", "serp", *command, "--out", str(run), "--quiet"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C ends the studio, which then stops the training
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as said:
            self._words.extend(said)

    @property
    def running(self) -> bool:
        """Whether the process goes on."""
        return self._process.poll() is None

    def stop(self, *, wait: float = 0.0) -> None:
        """Let the training finish its episode and save; after `wait` seconds, if any, end it."""
        if not self.running:
            return
        self._process.send_signal(signal.SIGINT)
        if wait:
            try:
                self._process.wait(wait)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def progress(self) -> TrainingProgress:
        """Return what has been written so far; this may take some tenths of a second."""
        running = self.running
        said = (
            "" if running or self._process.returncode in (0, 130) else "".join(self._words).strip()
        )
        found: dict[str, Any] = {}
        # Files may not be there yet, or be in the middle of being written.
        with contextlib.suppress(RunError, OSError):
            metrics = read_metrics(self.run / METRICS)
            found["env_steps"] = metrics["env_steps"].tolist()
            found["returns"] = metrics["return"].tolist()
            found["rho"] = metrics["rho"].tolist()
        with contextlib.suppress(RunError, OSError):
            recording = open_recording(self.run)
            found["vetoes"] = vetoes_by_reason(recording)
            if self._model is not None:
                found["error_steps"], found["errors"] = model_errors(recording, self._model)
        return TrainingProgress(running, **found, said=said)


def vetoes_by_reason(recording: Recording) -> dict[str, int]:
    """Return reason → number of proposals that were refused for it, the most frequent first."""
    layout, reasons = recording.layout, recording.columns("reason")["reason"]
    names, counts = np.unique(reasons[vetoed(recording)], return_counts=True)
    found = {layout.reasons[k]: int(n) for k, n in zip(names, counts, strict=True)}
    return dict(sorted(found.items(), key=lambda each: -each[1]))


def model_errors(
    recording: Recording, model: TransitionModel
) -> tuple[list[int], dict[str, list[float]]]:
    """Return the model's error one step ahead over a run, in windows of as many steps.

    Steps that end an episode, and actions that the model does not know, are left out.
    """
    names = [fluent.name for fluent in model.fluents]
    if tuple(names) != recording.layout.fluents or len(recording) < 2 * _WINDOWS:
        return [], {}
    columns = recording.columns("state", "episode", "action", "ground")
    states, ground = columns["state"], columns["ground"]
    order = np.argsort(columns["episode"], kind="stable")
    follows = np.flatnonzero(np.diff(columns["episode"][order]) == 0)
    before, after = order[follows], order[follows + 1]
    actions = ground[before, columns["action"][before]].astype(np.int64)
    known = actions >= 0
    before, after, actions = before[known], after[known], actions[known]
    if not len(before):
        return [], {}
    predicted = model.step(states[before], actions)
    there = predicted.applicable
    wrong = np.square(states[after] - predicted.state)[there]
    usual = recording.usual_change
    steps, errors = _windows(before[there], wrong, usual)
    largest = np.argsort(-np.nan_to_num(errors).mean(axis=0), kind="stable")
    shown = [k for k in largest.tolist() if usual[k] > 0][:_MOST_FLUENTS]
    return steps, {names[k]: errors[:, k].tolist() for k in shown}


def _windows(
    steps: NDArray[np.int64], squares: NDArray[np.float64], usual: NDArray[np.float64]
) -> tuple[list[int], NDArray[np.float64]]:
    order = np.argsort(steps, kind="stable")
    parts = [part for part in np.array_split(order, _WINDOWS) if len(part)]
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.array([np.sqrt(squares[part].mean(axis=0)) / usual for part in parts])
    return [int(steps[part[-1]]) for part in parts], errors


def run_folder(folder: Path, name: str) -> Path:
    """Return a folder for a new run in the working folder."""
    return folder / "runs" / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
