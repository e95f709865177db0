"""A run on the disk: what came out of a training, and what it can be used for."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from serp._util.numbers import whole
from serp._util.saved_state import Saved
from serp._util.terminal import bar
from serp._util.threads import one_thread
from serp.control.decision import Decision
from serp.errors import RunError, SettingsError
from serp.model.loading import load_domain
from serp.runs.checkpoint import Checkpoint
from serp.runs.folder import METRICS, RunFolder
from serp.runs.reading import read_metrics
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import load_task
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.evaluation import EPISODES, EvaluationResult, evaluate
from serp.training.policies import Policy
from serp.training.run_metadata import read_run_metadata, refuse_changes


def load_run(folder: str | Path, task: Task | None = None) -> Run:
    """Open a run.

    Args:
        folder: The run's folder.
        task: The task it was trained on; by default the installed task of that name.

    Raises:
        RunError: It is no run, or a file of it is damaged.
        TaskError: The task is not installed here.
    """
    if not isinstance(folder, str | os.PathLike):
        raise RunError(f"a run is given by its folder, not by {folder!r}")
    opened = RunFolder.open(folder)
    if task is None:
        task = load_task(read_run_metadata(opened).task)
    return Run(Path(folder), task_of_run(opened, task))


class Run:
    """A run on the disk.

    Attributes:
        path: Its folder.
        task: The task, with the domain as the run has it.
    """

    def __init__(self, path: Path, task: Task) -> None:
        self.path = path
        self.task = task

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r})"

    @functools.cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration."""
        return RunFolder.open(self.path).config

    @property
    def metrics(self) -> dict[str, NDArray[Any]]:
        """The metrics, column by column, an entry an episode."""
        return read_metrics(self.path / METRICS)

    @property
    def summary(self) -> dict[str, Any]:
        """What a reader wants first; see `summary.json`.

        Raises:
            RunError: The run has not come to an end yet.
        """
        return RunFolder.open(self.path).read_summary()

    @functools.cached_property
    def agent(self) -> Agent:
        """The agent as of the newest checkpoint.

        Raises:
            RunError: There is no whole checkpoint, or the run's files were changed since.
        """
        checkpoint = self._checkpoint
        folder = RunFolder.open(self.path)
        refuse_changes(folder, checkpoint)
        made = read_run_metadata(folder)
        # What the agent has to know of the environment outlives it.
        with self.task.bind() as bound:
            agent = Agent(bound, made.settings, made.seed)
        with reading(checkpoint) as saved:
            agent.load_state_dict(checkpoint.arrays, saved.part("agent")[1])
        return agent

    @property
    def notice(self) -> str | None:
        """What is to be known of the agent: that the newest checkpoint is damaged; else None."""
        damage = self._checkpoint.fallback
        return None if damage is None else f"{damage} The agent is that of the one before it."

    @functools.cached_property
    def _checkpoint(self) -> Checkpoint:
        return RunFolder.open(self.path).load_checkpoint()

    def decide(self, observation: Any) -> Decision:
        """Decide as the trained agent does, for one observation as the environment gives it.

        Raises:
            RunError: There is no whole checkpoint, or the run's files were changed since.
            EnvironmentFailure: The observation is none of the environment's space, or holds NaN.
            TaskError: The grounding failed.
        """
        return self.agent.decide_greedily(*self.agent.perceive(observation))

    def evaluate(
        self,
        policy: Policy = "serp",
        *,
        episodes: int = EPISODES,
        seed: int = 0,
        quiet: bool = False,
    ) -> EvaluationResult:
        """Evaluate a policy of the run in an environment of its own.

        Args:
            policy: `serp`: the trained agent within the vetoes, as `serp.Run.decide`; `planner`:
                the planner without the learner; `learner`: the learner's greedy choice without
                vetoes; `training`: who would act if training went on, within the vetoes. None of
                them explores.
            episodes: How many, at least 1.
            seed: Seed of the environment.
            quiet: Show no bar on a terminal.

        Raises:
            SerpError: The run or its task cannot be loaded, or the environment failed.
        """
        agent = self.agent
        title = f"{self.task.name}, policy {policy}"
        with (
            self.environment() as task,
            one_thread(),
            bar(title, whole(episodes, 1) or 1, quiet=quiet) as advance,
        ):
            return evaluate(agent, task, policy, episodes=episodes, seed=seed, on_episode=advance)

    @contextlib.contextmanager
    def environment(self, render_mode: str | None = None) -> Iterator[BoundTask]:
        """Give the task in an environment of its own, with the statistics of the training.

        What is left behind in it reaches nobody else; it is closed at the end.

        Args:
            render_mode: For an environment that draws; one of Gymnasium's render modes.

        Raises:
            SerpError: The task cannot be loaded, or does not draw.
        """
        with self.task.bind(render_mode=render_mode) as task:
            with reading(self._checkpoint) as saved:
                task.restore_environment(saved.part("environment")[1], statistics_only=True)
            yield task


def task_of_run(folder: RunFolder, task: Task) -> Task:
    """Return the task as the run has it, whatever became of its domain file since.

    Raises:
        RunError: The run is one of another task.
    """
    made = read_run_metadata(folder)
    if task.name not in (None, made.task):
        raise RunError(f"{folder.path} is a run of task {made.task}, not of {task.name}")
    domain = load_domain(
        folder.domain_file,
        folder.problem_file,
        observed=True,
        max_ground_schemas=made.max_ground_schemas,
    )
    return dataclasses.replace(
        task, domain=domain, problem=None, name=made.task, reward=made.reward, dt=made.dt
    )


@contextlib.contextmanager
def reading(checkpoint: Checkpoint) -> Iterator[Saved]:
    """Give what a checkpoint says; an error about it names the file."""
    try:
        yield Saved("run", {}, checkpoint.meta)
    except (RunError, SettingsError) as error:
        raise RunError(f"{checkpoint.path}: {error}") from error
