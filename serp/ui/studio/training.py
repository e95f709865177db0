"""A training in the background: a process of its own, and what it has written so far."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from serp._util.processes import python_command
from serp.errors import RunError
from serp.model.transition_model import TransitionModel
from serp.runs.folder import METRICS
from serp.runs.recording import open_recording
from serp.runs.tables import read_metrics
from serp.ui.studio.measured import MeasuredRun

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
        self._measured = MeasuredRun(model)
        self._words: deque[str] = deque(maxlen=_LAST_LINES)
        self._process = subprocess.Popen(
            python_command("serp", *command, "--out", str(run), "--quiet"),
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
        """Return what has been written so far; only what is new in the recording is measured."""
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
            self._measured.read(open_recording(self.run))
        found["vetoes"] = self._measured.vetoes
        found["error_steps"], found["errors"] = self._measured.errors()
        return TrainingProgress(running, **found, said=said)


def run_folder(folder: Path, name: str) -> Path:
    """Return a folder for a new run in the working folder."""
    return folder / "runs" / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
