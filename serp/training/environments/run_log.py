"""The run folder of a training that another library drives."""

from __future__ import annotations

import datetime
from pathlib import Path

from serp._util.compile_time import compile_seconds, working_time
from serp.control.arbiter import Arbiter
from serp.control.decision import Decision
from serp.control.step_record import EpisodeTotals
from serp.model.transition_model import Vector
from serp.runs.folder import RunFolder
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

    def decision(
        self, decision: Decision, arbiter: Arbiter, state: Vector, step: int, episode: int
    ) -> None:
        """Write a decision."""
        if self._folder is not None:
            row = decision_row(decision, arbiter, state, step=step, episode=episode)
            self._folder.decisions.append(row)

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
        with folder:
            seconds = compile_seconds() - self._compiled
            write_results(folder, compile_seconds=seconds, account=account_of(agent))
