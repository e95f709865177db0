"""A run on the disk: its results, its trained agent and the evaluation of its policies."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import functools
import hashlib
import json
import os
import sys
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium as gym
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    ValidationError,
)

from serp._util.files import read_regular
from serp._util.numbers import COUNTED, seed_of, whole
from serp._util.processes import one_thread
from serp._util.saved_state import Saved
from serp._util.terminal import bar
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.errors import RunError, SettingsError
from serp.model.domain import load_domain, problem_beside
from serp.runs.checkpoint import Checkpoint
from serp.runs.evaluation import EPISODES, EvaluationResult, Policy, check_policy, evaluate
from serp.runs.folder import CONFIG, METRICS, RunFolder
from serp.runs.recording import Layout, Recorder, Recording, open_recording, recorded_evaluation
from serp.runs.tables import read_metrics
from serp.runs.trainer import Budget
from serp.settings import Settings
from serp.tasks.environment import BoundTask
from serp.tasks.file_world import WorldOptions, world_task
from serp.tasks.registry import load_task
from serp.tasks.task import Task, reward_source


class RunMetadata(BaseModel):
    """The part of a run's configuration that it is read back with."""

    model_config = ConfigDict(frozen=True, strict=True)

    task: str
    """Name of the task."""
    seed: NonNegativeInt
    """Seed of everything random."""
    reward: Literal["domain", "environment"]
    """The source of the reward that the task declares."""
    control_period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Seconds between two decisions."""
    settings: Annotated[Settings, BeforeValidator(Settings.from_dict)]
    """All settings."""
    budget: Annotated[Budget, BeforeValidator(Budget.from_dict)]
    """The budget that the run began with."""
    observed: list[str] | None = []
    """Fluents that the environment gives although the problem's `:init` states them. None: all
    states can be reached from there, see `Task.closed`."""
    max_ground_schemas: Annotated[int, Field(ge=1, le=COUNTED)]
    """Limit on the size of each grounded domain."""
    world: Annotated[WorldOptions, BeforeValidator(WorldOptions.from_dict)] | None = None
    """What the environment was made with, if it was made of the file itself."""
    baseline: bool = False
    """Whether the learner always acts and nothing is refused, see `serp.agent.agent.Agent`."""


def begin_run(
    path: Path,
    task: BoundTask,
    settings: Settings,
    *,
    preset: str,
    seed: int,
    budget: Budget,
    begun: datetime.datetime,
    baseline: bool = False,
) -> RunFolder:
    """Begin a run in a new or empty folder, and lock it for writing."""
    config = {
        "task": task.name,
        "domain": task.domain.name,
        "observed": None if task.task.closed else sorted(task.domain.supplied or ()),
        "world": None if task.task.world is None else task.task.world.as_dict(),
        "max_ground_schemas": task.domain.max_ground_schemas,
        "preset": preset,
        "seed": seed,
        "baseline": baseline,
        "reward": task.rewarded_by,
        "learned_from": reward_source(task.rewarded_by, settings),
        "file_rewards": task.model.rewarding,
        "control_period": task.model.dt,
        "budget": budget.as_dict(),
        "settings": settings.as_dict(),
    }
    texts = [(source.name, source.text) for source in task.domain.sources]
    return RunFolder.create(path, config, texts, command=sys.argv, now=begun)


def read_run_metadata(folder: RunFolder) -> RunMetadata:
    """Read a run's configuration; raise `RunError` if a value is missing or wrong."""
    try:
        return RunMetadata.model_validate(folder.config)
    except (ValidationError, SettingsError) as error:
        what = str(error)
        if isinstance(error, ValidationError):
            first = error.errors(include_url=False)[0]
            what = f"{first['loc'][0]}: {first['msg']}"
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error


def content_digests(folder: RunFolder) -> dict[str, str]:
    """Return digests of a run's domain files and of its configuration except the budget."""
    config = {name: value for name, value in folder.config.items() if name != "budget"}
    made = {CONFIG: json.dumps(config, sort_keys=True).encode()}
    domain, problem = folder.copies()
    beside = problem_beside(domain)  # perhaps not written by serp, but it would be loaded
    for file in (domain, problem, beside):
        if file is not None and (file is not beside or os.path.lexists(file)):
            try:
                made[file.name] = read_regular(file)
            except OSError as error:
                raise RunError(f"cannot read {file}: {error.strerror or error}") from error
    return {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}


def refuse_changes(folder: RunFolder, checkpoint: Checkpoint, *, domain_only: bool = False) -> None:
    """Check that the files of a run are those that a checkpoint of it began with.

    Raises:
        RunError: A domain file, or the configuration unless `domain_only`, was changed.
    """
    _, before = Saved("run", {}, checkpoint.meta).part("made_of")
    if not isinstance(before, dict):
        raise RunError(f"{checkpoint.path} holds no digests of the run's files")
    now = content_digests(folder)
    for name in sorted((before.keys() | now.keys()) - ({CONFIG} if domain_only else set())):
        if before.get(name) != now.get(name):
            raise RunError(
                f"{name} of the run was changed since it began, so that it does not fit what was "
                "learned; undo the change, or begin a new run with it"
            )


def load_run(folder: str | Path, task: Task | None = None) -> Run:
    """Open a run.

    Args:
        folder: The run's folder.
        task: The task it was trained on; by default the installed task of that name, or the world
            of the run's own files.

    Raises:
        RunError: It is not a run, or a file of it is damaged.
        TaskError: The task is not installed.
    """
    if not isinstance(folder, str | os.PathLike):
        raise RunError(f"a run is given by its folder, not by {folder!r}")
    return Run(Path(folder), task_of_run(RunFolder.open(folder), task))


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
        """The content of `summary.json`.

        Raises:
            RunError: The run has not ended yet.
        """
        return RunFolder.open(self.path).read_summary()

    @functools.cached_property
    def agent(self) -> Agent:
        """The agent as of the newest checkpoint.

        Raises:
            RunError: There is no intact checkpoint, or the run's files were changed since.
        """
        checkpoint = self._checkpoint
        folder = RunFolder.open(self.path)
        refuse_changes(folder, checkpoint)
        made = read_run_metadata(folder)
        # The agent needs the environment only while it is made.
        with self.task.bind() as bound:
            agent = Agent(bound, made.settings, made.seed, baseline=made.baseline)
        with reading(checkpoint) as saved:
            agent.load_state_dict(checkpoint.arrays, saved.part("agent")[1])
        return agent

    @property
    def notice(self) -> str | None:
        """A message if the newest checkpoint is damaged and the previous one is used; else None."""
        damage = self._checkpoint.fallback
        return None if damage is None else f"{damage} The agent is from the previous checkpoint."

    @functools.cached_property
    def _checkpoint(self) -> Checkpoint:
        return RunFolder.open(self.path).load_checkpoint()

    def decide(
        self,
        observation: Any,
        info: Mapping[str, Any] | None = None,
        env: gym.Env[Any, Any] | None = None,
    ) -> Decision:
        """Decide by the trained agent for one observation of the environment.

        The environment's info and the environment are needed if the task's grounding takes them.

        Raises:
            RunError: There is no intact checkpoint, or the run's files were changed since.
            EnvironmentFailure: The observation is not a member of the space, or holds NaN.
            TaskError: The grounding failed, or takes what is not given.
        """
        return self.agent.decide_greedily(*self.agent.perceive(observation, info, env))

    def option(self, *, steps: int) -> Callable[[Any], Generator[Any, Any, None]]:
        """Return the trained policy as an option for `serp_envs.MacroActions`.

        So the run's task is an action of another one. The option decides as `decide` does, for a
        number of env steps, or until the run's domain file calls an observed step `terminal`.
        Equal observations make equal decisions, whatever the option did before.

        Args:
            steps: Most env steps, at least 1.

        Raises:
            RunError: There is no intact checkpoint, or the grounding takes more than observations.
        """
        agent = self.agent
        if agent.task.grounding.takes:
            raise RunError(
                f"{self.path}: the grounding of task {self.task.name} takes "
                f"{' and '.join(agent.task.grounding.takes)}; an option gets observations only"
            )

        def decide(observation: Any) -> Generator[Any, Any, None]:
            with agent.undisturbed():
                state, x = agent.perceive(observation)
                for _ in range(steps):
                    decision = agent.decide_greedily(state, x)
                    ground = int(decision.forecast.ground[decision.action])
                    before = state
                    observation = yield agent.task.action_space.action(decision.action)
                    state, x = agent.perceive(observation)
                    if agent.task.model.judge(before, ground, state).terminal:
                        return

        return decide

    def evaluate(
        self,
        policy: Policy = "serp",
        *,
        episodes: int = EPISODES,
        seed: int = 0,
        record: bool = False,
        quiet: bool = False,
    ) -> EvaluationResult:
        """Evaluate a policy of the run in a new environment.

        Args:
            policy: `serp`: the trained agent within the vetoes, as `serp.Run.decide`; `planner`:
                the planner without the learner; `learner`: the learner's greedy choice without
                vetoes.
                None of them explores.
            episodes: Number of episodes, at least 1.
            seed: Seed of the environment.
            record: Record the steps in the run's folder, as `evaluations/<policy>-seed<seed>`.
            quiet: Show no progress bar on a terminal.

        Raises:
            SerpError: The run or its task cannot be loaded, or the environment failed.
        """
        agent = self.agent
        title = f"{self.task.name}, policy {policy}"
        with (
            self.environment() as task,
            one_thread(),
            bar(title, whole(episodes, 1) or 1, quiet=quiet) as advance,
            self.recorder(policy, seed) if record else contextlib.nullcontext() as recorder,
        ):
            return evaluate(
                agent, task, policy, episodes=episodes, seed=seed, on_episode=advance,
                recorder=recorder,
            )  # fmt: skip

    def recording(self, evaluation: str | None = None) -> Recording:
        """Return the recorded steps of the training, or of an evaluation.

        Args:
            evaluation: The name of the evaluation: `<policy>-seed<seed>`.

        Raises:
            RunError: There are none, or they are damaged.
        """
        return open_recording(self.path, evaluation)

    def recorder(
        self, policy: Policy, seed: int
    ) -> contextlib.AbstractContextManager[Recorder | None]:
        """Return the recorder of an evaluation of the run; see `recorded_evaluation`."""
        check_policy(policy)
        seed = seed_of(seed)
        arbiter = self.agent.arbiter
        layout = Layout.of(arbiter.model, arbiter.actions, policy=policy, seed=seed)
        return recorded_evaluation(self.path, f"{policy}-seed{seed}", layout)

    @contextlib.contextmanager
    def environment(self, render_mode: str | None = None) -> Iterator[BoundTask]:
        """Yield the task in a new environment with the running statistics of the training.

        The environment is closed at the end.

        Args:
            render_mode: One of Gymnasium's render modes, if pictures are needed.

        Raises:
            SerpError: The task cannot be loaded, or does not draw.
        """
        with self.task.bind(render_mode=render_mode) as task:
            with reading(self._checkpoint) as saved:
                environments = Saved("run", {}, saved.part("environments")[1])
                task.restore_environment(environments.part("0")[1], statistics_only=True)
            yield task


def task_of_run(folder: RunFolder, task: Task | None = None) -> Task:
    """Return a run's task with the run's own copies of its domains; refuse another task.

    By default it is the world that the run's files describe, if it was trained on that, else the
    installed task of that name.
    """
    made = read_run_metadata(folder)
    if task is not None and task.name not in (None, made.task):
        raise RunError(f"{folder.path} is a run of task {made.task}, not of {task.name}")
    limit = made.max_ground_schemas
    if task is None and made.world is None:
        task = load_task(made.task)
    domain = load_domain(
        *folder.copies(), observed=task is not None and not task.closed, max_ground_schemas=limit
    )
    if task is None:
        assert made.world is not None
        task = world_task(domain, made.world, made.control_period)
    return dataclasses.replace(
        task,
        domain=domain,
        problem=None,
        name=made.task,
        reward=made.reward,
        dt=made.control_period,
    )


@contextlib.contextmanager
def reading(checkpoint: Checkpoint) -> Iterator[Saved]:
    """Yield the values of a checkpoint; errors in the body name the file."""
    try:
        yield Saved("run", {}, checkpoint.meta)
    except (RunError, SettingsError) as error:
        raise RunError(f"{checkpoint.path}: {error}") from error
