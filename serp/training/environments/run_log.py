"""The run folder of a training that another library drives."""

from __future__ import annotations

import contextlib
import datetime
from pathlib import Path

from serp._util.compile_time import compile_seconds, working_time
from serp.control.arbiter import Arbiter
from serp.control.step_record import EpisodeTotals, StepRecord
from serp.runs.folder import RunFolder
from serp.runs.recorder import Recorder
from serp.runs.recording_format import RECORDING, Layout
from serp.runs.rows import decision_row, metrics_row
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.training.account import account_of
from serp.training.agent import Agent
from serp.training.budget import Budget
from serp.training.run_metadata import begin_run


class RunLog:
    """Writes what `serp.plan_and_learn` writes of a training, but for checkpoints.

    Args:
        task: The task.
        settings: All settings.
        preset: Their preset.
        seed: The seed.
        path: Folder of the run; None: nothing is written.
        begun: The time of the beginning.
    """

    def __init__(
        self,
        task: BoundTask,
        settings: Settings,
        preset: str,
        seed: int,
        path: Path | str | None,
        begun: datetime.datetime,
    ) -> None:
        self._clock, self._compiled = working_time(), compile_seconds()
        self._folder: RunFolder | None = None
        self._recorder: Recorder | None = None
        if path is not None:
            self._folder = begin_run(
                Path(path),
                task,
                settings,
                preset=preset,
                seed=seed,
                budget=Budget(),
                begun=begun,
            )
            if settings.training.record:
                layout = Layout.of(task.model, task.actions)
                self._recorder = Recorder(self._folder.path / RECORDING, layout)

    def step(self, step: StepRecord, arbiter: Arbiter, number: int, episode: int) -> None:
        """Write a step and its decision; `number` counts env steps from 0."""
        if self._folder is not None:
            row = decision_row(step.decision, arbiter, step.state, step=number, episode=episode)
            self._folder.decisions.append(row)
        if self._recorder is not None:
            self._recorder.append(episode, step)

    def episode(self, totals: EpisodeTotals, rho: float, env_steps: int, episode: int) -> None:
        """Write an episode."""
        if self._folder is not None:
            row = metrics_row(
                totals,
                episode=episode,
                env_steps=env_steps,
                rho=rho,
                epsilon=None,
                losses=(),
                wall_time=working_time() - self._clock,
            )
            self._folder.metrics.append(row)

    def close(self, agent: Agent) -> None:
        """Write the results; a second call does nothing."""
        if self._folder is None:
            return
        from serp.runs.results import write_results  # imports matplotlib

        folder, self._folder = self._folder, None
        with folder, self._recorder or contextlib.nullcontext():
            seconds = compile_seconds() - self._compiled
            write_results(folder, compile_seconds=seconds, account=account_of(agent))
