"""What a training counts and writes into its run folder while it goes on: steps and episodes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from serp._util.files import Closing
from serp.agent.step_record import DecisionCounts, EpisodeTotals, StepRecord
from serp.runs.folder import DECISIONS, METRICS
from serp.runs.recording import RECORDING, Layout, Recorder
from serp.runs.tables import DECISIONS_COLUMNS, METRICS_COLUMNS, MetricsRow, Table, decision_row
from serp.tasks.environment import BoundTask


class RunLog(Closing):
    """Writes the steps and episodes of a training: tables and recording. A context manager.

    What was written after the `env_steps` and `episodes` that the run has made is removed.

    Raises:
        RunError: Less than that is there, it is of another run, or the disk fails.
    """

    def __init__(
        self, folder: Path, task: BoundTask, env_steps: int = 0, episodes: int = 0
    ) -> None:
        self._name = task.actions.name
        layout = Layout.of(task.model, task.actions)
        with contextlib.ExitStack() as stack:
            enter = stack.enter_context
            self.metrics = enter(Table(folder / METRICS, METRICS_COLUMNS, episodes))
            self._decisions = enter(Table(folder / DECISIONS, DECISIONS_COLUMNS, env_steps))
            self._recorder = enter(Recorder(folder / RECORDING, layout, env_steps))
            self._open = stack.pop_all()

    def step(self, step: StepRecord, *, env_step: int, episode: int) -> None:
        """Write a step and its decision: `env_step` counts from 0, `episode` from 1."""
        row = decision_row(step.decision, self._name, step=env_step, episode=episode)
        self._decisions.append(row)
        self._recorder.append(episode, step)

    def flush(self) -> dict[str, Any]:
        """Write what is buffered, wait until the disk holds it; return what the tables hold."""
        self._recorder.flush()
        self.metrics.sync()
        self._decisions.sync()
        return {METRICS: self.metrics.written(), DECISIONS: self._decisions.written()}

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self._open.close()


class Bookkeeping:
    """The numbers of complete episodes and of steps, counts over these, and the time so far."""

    def __init__(self) -> None:
        self.episode = self.env_steps = 0
        self.tally = DecisionCounts()
        self.log: RunLog | None = None  # where steps and episodes are written
        self._wall_before, self._clock = 0.0, time.monotonic()

    @property
    def wall_time(self) -> float:
        """Seconds of training, without pauses between resumptions."""
        return self._wall_before + time.monotonic() - self._clock

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Exclude the body from `wall_time`."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self._clock += time.monotonic() - begun

    def record_step(self, step: StepRecord, episode: int) -> None:
        """Count and write a step of an episode, whose number counts from 1."""
        if self.log is not None:
            self.log.step(step, env_step=self.env_steps, episode=episode)
        self.tally.count(step.decision)
        self.env_steps += 1

    def record_episode(
        self, totals: EpisodeTotals, rho: float, epsilon: float | None = None,
        losses: Sequence[float] = (),
    ) -> MetricsRow:  # fmt: skip
        """Count and write an episode; return its row of the metrics."""
        self.episode += 1
        own = {name: getattr(totals, name) for name in MetricsRow._fields if hasattr(totals, name)}
        counts: dict[str, Any] = totals.decisions.numbers()
        row = MetricsRow(
            episode=self.episode,
            env_steps=self.env_steps,
            rho=rho,
            epsilon=epsilon,
            loss=float(np.mean(losses)) if losses else None,
            wall_time=self.wall_time,
            **own,
            **counts,
        )
        if self.log is not None:
            self.log.metrics.append(row)
        return row
