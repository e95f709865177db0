"""What the trials of a study have in common: task, budget, seeds, and what is measured."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import numpy as np

from serp.comparison.algorithms import find_algorithm
from serp.comparison.analysis.measures import measure
from serp.comparison.folder import texts_of
from serp.comparison.plan import ComparisonProtocol
from serp.comparison.trial_files import digest
from serp.comparison.trial_records import EPISODE_COLUMNS, EVALUATION_COLUMNS, Record, Trial
from serp.comparison.trials.trial import Measured
from serp.comparison.workers import Job, Pool, run_here, run_in_executor
from serp.errors import RunError, SettingsError
from serp.settings import Changes
from serp.tasks.task import Task
from serp.tuning.request import TuningRequest
from serp.tuning.space import dimensions

_FINAL = {"guided": "final_vetoed", "baseline": "final_learner", "planner": "planner"}
"""Kind of an algorithm → the measure of its trained policy."""


class Search:
    """Trains with settings, and returns what they are worth.

    Attributes:
        name: Name of the task.
        request: The options.
        space: What is varied.
        digest: Digest of everything that the values of a study depend on.
    """

    def __init__(self, task: Task, request: TuningRequest) -> None:
        self.request, self.space = request, dimensions(request.vary)
        self._algorithm = algorithm = find_algorithm(request.algorithm)
        if algorithm.kind == "external":
            raise SettingsError(f"`{algorithm.name}` has no settings that serp could tune")
        with task.bind() as bound:  # checks the task
            self.name = bound.name
            self._task = bound.task
        self._settings = algorithm.settings(task, request.settings)
        steps = request.env_steps or self._settings.training.env_steps
        evaluated = request.objective == "evaluation"
        self._protocol = ComparisonProtocol(
            env_steps=steps, evaluate_every=steps, final_episodes=50 if evaluated else 1
        )
        self._measure = _FINAL[algorithm.kind] if evaluated else "training_area"
        parts: dict[str, Any] = {
            "task": self.name,
            "texts": texts_of(self._task),
            "settings": self._settings.as_dict(),
            "protocol": self._protocol.model_dump(),
            "measure": self._measure,
            "seeds": list(request.seeds),
            "space": [repr(dimension) for dimension in self.space],
            "search": [algorithm.kind, request.seed, request.prune],
        }
        self.digest = digest(parts)

    def own_parameters(self) -> dict[str, Any]:
        """Return the settings as they are, in Optuna's form; empty if one is not in the space."""
        settings = self._settings
        found = {
            dimension.name: dimension.parameter(
                getattr(getattr(settings, dimension.section), dimension.setting)
            )
            for dimension in self.space
        }
        return {} if None in found.values() else found

    def jobs(self, varied: Changes) -> list[Job]:
        """Return the trainings with some settings, one for each seed.

        Raises:
            SettingsError: The settings contradict one another.
        """
        algorithm = self._algorithm.changed(self._algorithm.name, varied)
        settings = algorithm.settings(self._task, self.request.settings)
        return [
            Job(
                Trial(algorithm.name, self.name, s), algorithm, self._task, settings, self._protocol
            )
            for s in self.request.seeds
        ]

    def returns(
        self, varied: Changes, pool: Pool | None, stopped: Callable[[], bool]
    ) -> Generator[float, None, None]:
        """Train, and yield what each seed is worth, in the order of the seeds, until `stopped`.

        Without a pool the trainings run in this process.

        Raises:
            SettingsError: The settings contradict one another.
            RunError: A training failed.
        """

        def on_progress(trial: Trial, env_steps: int) -> None:
            stopped()

        jobs = self.jobs(varied)
        ends = (
            run_here(jobs, on_progress, stopped)
            if pool is None
            else run_in_executor(jobs, pool, on_progress, stopped)
        )
        found: dict[int, float] = {}
        waiting = iter(self.request.seeds)
        seed = next(waiting, None)
        for ended in ends:
            if ended.measured is None:
                raise RunError(f"seed {ended.trial.seed}: {ended.error}")
            found[ended.trial.seed] = self._value(ended.trial, ended.measured)
            while seed in found:
                yield found[seed]
                seed = next(waiting, None)

    def _value(self, trial: Trial, measured: Measured) -> float:
        names = [*EPISODE_COLUMNS, *(f"info.{name}" for name in measured.log.counters)]
        episodes = _columns(names, [(*row, *counts) for row, counts in measured.log.rows])
        evaluations = _columns(EVALUATION_COLUMNS, measured.evaluations)
        record = Record(trial, episodes, evaluations, {"seconds": measured.seconds})
        value = measure(record, self._protocol.env_steps, None)[self._measure]
        if not np.isfinite(value):
            raise RunError(
                f"seed {trial.seed}: no episode ended within {self._protocol.env_steps} env steps, "
                "so nothing was measured; give a larger --env-steps"
            )
        return value


def _columns(names: Any, rows: Any) -> dict[str, Any]:
    return {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}
