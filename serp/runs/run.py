"""A run on the disk: its results, its trained agent and the evaluation of its policies."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import json
import os
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from filelock import FileLock
from numpy.typing import NDArray

from serp._util.files import (
    Closing,
    make_inside,
    read_json,
    read_regular,
    require_regular,
    write_durably,
)
from serp._util.numbers import seed_of, whole
from serp._util.processes import one_thread
from serp._util.saved_state import Saved
from serp._util.terminal import bar
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.errors import Notice, RunError, SettingsError
from serp.model.domain import Domain
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.transition_model import TransitionModel
from serp.pddl.source import Source
from serp.runs.checkpoint import CHECKPOINT, Checkpoint, load
from serp.runs.evaluation import EPISODES, EvaluationResult, Policy, check_policy, evaluate
from serp.runs.folder import COPIES, METRICS, SUMMARY, lock_folder, make_empty, refuse_occupied
from serp.runs.recording import EVALUATIONS, Layout, Recorder, Recording, open_recording
from serp.runs.run_config import CONFIG, Budget, RunConfig, read_metadata, write_metadata
from serp.runs.tables import read_metrics
from serp.settings import Settings
from serp.tasks.environment import BoundTask
from serp.tasks.file_world import world_task
from serp.tasks.registry import load_task, task_entries
from serp.tasks.task import Task, reward_source


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
        raise RunError(f"give the folder of a run, not {folder!r}")
    run = Run(Path(folder), task)
    _ = run.task  # whose errors are raised here
    return run


def digests(config: Mapping[str, Any], files: Mapping[str, bytes]) -> dict[str, str]:
    """Return digests of a run's domain files and of its configuration except the budget."""
    kept = {name: value for name, value in config.items() if name != "budget"}
    contents = {CONFIG: json.dumps(kept, sort_keys=True).encode(), **files}
    return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}


class Run(Closing):
    """A run on the disk. Only acting in its environment needs the task that it was trained on.

    A context manager, at whose end another process may write the run. See `load_run`.

    Attributes:
        path: Its folder.
        metadata: The content of ``config.json``.
        made: The configuration in it, checked.

    Raises:
        RunError: The folder is not a run.
    """

    def __init__(self, path: Path, task: Task | None = None) -> None:
        self.path = path
        self.metadata, self.made = read_metadata(path)
        self._task = task
        self._lock: FileLock | None = None

    @classmethod
    def begin(
        cls,
        path: Path,
        task: BoundTask,
        settings: Settings,
        *,
        preset: str,
        seed: int,
        budget: Budget,
        baseline: bool = False,
    ) -> Run:
        """Begin a run in a new or empty folder, also after a failure; lock it for writing."""
        config = RunConfig(
            task=task.name,
            domain=task.domain.name,
            observed=None if task.task.closed else sorted(task.domain.supplied or ()),
            world=task.task.world,
            code=task.task.code,
            max_ground_schemas=task.domain.max_ground_schemas,
            preset=preset,
            seed=seed,
            baseline=baseline,
            reward=task.rewarded_by,
            learned_from=reward_source(task.rewarded_by, settings),
            file_rewards=task.model.rewarding,
            control_period=task.model.dt,
            budget=budget,
            settings=settings,
        )
        sources = dict(zip(COPIES, task.domain.sources, strict=False))
        make_empty(path)
        lock = lock_folder(path)
        try:
            refuse_occupied(path)  # another process may have begun a run since
            for copy, source in sources.items():
                write_durably(path / copy, source.text)
            # The last, because it makes the folder a run.
            write_metadata(path, config, {copy: own.name for copy, own in sources.items()})
            run = cls(path, task.task)
        except BaseException:
            lock.release()
            raise
        run._lock = lock
        return run

    def lock(self) -> Run:
        """Lock it for writing, until `close`; return it."""
        self._lock = lock_folder(self.path)
        return self

    def close(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._lock is not None:
            self._lock.release()

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r})"

    @property
    def config(self) -> Any:
        """The resolved configuration, as JSON values by name."""
        return self.metadata["config"]

    @property
    def learned_reward(self) -> str:
        """The reward that the learner learns from, in words."""
        if self.made.learned_from == "domain":
            return "the rewards of the domain file; the returns shown are the environment's"
        if self.made.learned_from == "sum":
            return "the environment's reward plus those of the domain file"
        if not self.made.file_rewards:
            return "the environment's reward; the domain file gives none"
        if self.made.world is not None:
            return "the rewards of the domain file, computed from what actually happened"
        return (
            "the environment's reward, and the planner plans with the file's. With "
            "training.reward=sum, the learner learns from both; with training.reward=domain, only "
            "from the file's"
        )

    @property
    def metrics(self) -> dict[str, NDArray[Any]]:
        """The metrics, column by column, an entry an episode."""
        return read_metrics(self.table(METRICS, self.checkpoint if self.has_checkpoint else None))

    def table(self, name: str, checkpoint: Checkpoint | None) -> Path:
        """Return the path of a table, which is as the run had written it at the checkpoint."""
        path, saved = self.path / name, Saved("run", *(checkpoint or ({}, {})))
        if saved.has("tables"):  # an exported policy has none
            written = Saved(name, *Saved("tables", *saved.part("tables")).part(name))
            content = read_regular(path)[: written.whole("bytes")]
            if hashlib.sha256(content).hexdigest() != written.part("sha256")[1]:
                raise RunError(
                    f"{path} is not what the run wrote: it has been changed or damaged since. "
                    "Restore it from a copy, or begin a new run with another --out."
                )
        return path

    @property
    def summary(self) -> dict[str, Any]:
        """The content of `summary.json`; a RunError if the run has not ended yet."""
        return read_json(self.path / SUMMARY, "It is written when the run ends.")

    def copies(self) -> list[Path]:
        """Return the copies of the domain and, if it has one, of its problem."""
        names = COPIES if COPIES[1] in self.metadata["domain_files"] else COPIES[:1]
        return [require_regular(self.path / name) for name in names]

    def _parsed(self) -> Domain:
        sources = [Source.read(copy) for copy in self.copies()]
        observed, limit = self.made.observed, self.made.max_ground_schemas
        domain = Domain.parse(*sources, observed=observed is not None, max_ground_schemas=limit)
        return domain if observed is None else domain.observed(observed)

    @functools.cached_property
    def domain(self) -> Domain:
        """The run's copy of the domain; a RunError or DomainError if it was changed since."""
        _ = self.has_checkpoint and self.checkpoint  # refuses changes
        return self._parsed()

    @functools.cached_property
    def model(self) -> TransitionModel:
        """The domain's transition model as written, with the task's control period."""
        return self.domain.model.replace(dt=self.made.control_period)

    @functools.cached_property
    def task(self) -> Task:
        """The task, with the domain, control period and reward as the run has them."""
        made, task = self.made, self._task
        if task is not None and task.name not in (None, made.task):
            raise RunError(f"{self.path} is a run of task {made.task}, not of {task.name}")
        if task is None and made.world is None:
            if made.code and made.task not in task_entries():
                raise RunError(
                    f"{self.path} was made with the task in {made.code}; give it with --task or, "
                    f"in Python: serp.load_run({str(self.path)!r}, task=task())"
                )
            task = load_task(made.task)
        domain = self._parsed()
        if task is None:
            assert made.world is not None
            task = world_task(domain, made.world, made.control_period)
        return dataclasses.replace(
            task, domain=domain, problem=None, name=made.task, reward=made.reward,
            dt=made.control_period,
        )  # fmt: skip

    def digests(self) -> dict[str, str]:
        """Return the digests of its files; see the function."""
        return digests(self.config, {file.name: read_regular(file) for file in self.copies()})

    @property
    def has_checkpoint(self) -> bool:
        """Whether it has saved a checkpoint; one that another library drives has none."""
        return os.path.lexists(self.path / CHECKPOINT)

    def read_checkpoint(self) -> Checkpoint:
        """Read the checkpoint.

        Raises:
            RunError: There is none, it is damaged, or file or configuration were changed since.
        """
        checkpoint = load(self.path / CHECKPOINT)
        _, before = Saved("run", {}, checkpoint.meta).part("made_of")
        if not isinstance(before, dict):
            raise RunError(f"{self.path / CHECKPOINT} holds no digests of the run's files")
        now = self.digests()
        for name in sorted(before.keys() | now.keys()):
            if before.get(name) != now.get(name):
                raise RunError(
                    f"{name} of the run was changed after the run began, so it no longer fits what "
                    "was learned; undo the change, or begin a new run"
                )
        return checkpoint

    @functools.cached_property
    def checkpoint(self) -> Checkpoint:
        """What `read_checkpoint` returns, read once."""
        return self.read_checkpoint()

    @contextlib.contextmanager
    def reading(self, checkpoint: Checkpoint) -> Iterator[Saved]:
        """Yield the values of a checkpoint of the run; errors in the body name the file."""
        try:
            yield Saved("run", {}, checkpoint.meta)
        except (RunError, SettingsError) as error:
            raise RunError(f"{self.path / CHECKPOINT}: {error}") from error

    @functools.cached_property
    def agent(self) -> Agent:
        """The agent as of the checkpoint; see `read_checkpoint`."""
        checkpoint = self.checkpoint
        # The agent needs the environment only while it is made.
        with self.task.bind() as bound:
            made = self.made
            agent = Agent(bound, made.settings, made.seed, baseline=made.baseline)
        with self.reading(checkpoint) as saved:
            agent.load_state_dict(checkpoint.arrays, saved.part("agent")[1])
        return agent

    @functools.cached_property
    def adaptation(self) -> ModelAdaptation:
        """What the checkpoint has learned of the model; see `read_checkpoint`."""
        unused = np.random.SeedSequence(0)  # nothing is drawn after loading
        adaptation = ModelAdaptation(self.model, self.made.settings.adaptation, unused)
        adaptation.load_state_dict(*self.saved_agent.part("adaptation"))
        return adaptation

    @property
    def saved_agent(self) -> Saved:
        """What the checkpoint has of the agent."""
        arrays, meta = self.checkpoint
        return Saved("agent", arrays, Saved("run", arrays, meta).part("agent")[1])

    @property
    def env_steps(self) -> int:
        """Env steps of the training until the checkpoint."""
        return Saved("run", *self.checkpoint).whole("env_steps")

    @property
    def adapted(self) -> TransitionModel | None:
        """The model of the checkpoint; None where nothing that was learned is in use."""
        if not self.has_checkpoint or self.adaptation.model.as_written:
            return None
        return self.adaptation.model

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
            SettingsError: `steps` is no whole number, or less than 1.
            RunError: There is no intact checkpoint, or the grounding takes more than observations.
        """
        if whole(steps, 1) is None:
            raise SettingsError(f"steps must be a whole number, at least 1, not {steps!r}")
        agent = self.agent
        if agent.task.grounding.takes:
            raise RunError(
                f"{self.path}: the grounding of task {self.task.name} takes "
                f"{' and '.join(agent.task.grounding.takes)}, but an option gets only observations"
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
                vetoes. None of them explores.
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
        """Return the recorded steps of the training, or of the evaluation `<policy>-seed<seed>`.

        Raises:
            RunError: There are none, they are damaged, or of another domain.
        """
        found = open_recording(self.path, evaluation)
        layout = found.layout
        names = tuple(fluent.name for fluent in self.model.fluents)
        ground = tuple(action.name for action in self.model.actions)
        if (layout.fluents, layout.ground_actions) != (names, ground):
            raise RunError(
                f"{found.folder} does not fit the domain of the run: its fluents or actions have "
                "other names. Restore it from a copy."
            )
        return found

    @contextlib.contextmanager
    def recorder(self, policy: Policy, seed: int) -> Iterator[Recorder | None]:
        """Yield the recorder of an evaluation, in place of an earlier one of that policy and seed.

        Where the folder of the run cannot be written, nothing is recorded, and a notice says so.
        """
        check_policy(policy)
        seed = seed_of(seed)
        arbiter = self.agent.arbiter
        layout = Layout.of(arbiter.model, arbiter.actions, policy=policy, seed=seed)
        with contextlib.ExitStack() as stack:
            recorder: Recorder | None = None
            try:
                folder = make_inside(self.path, EVALUATIONS, f"{policy}-seed{seed}")
                stack.callback(lock_folder(folder).release)
                recorder = stack.enter_context(Recorder(folder, layout))
            except (RunError, OSError) as error:
                warnings.warn(f"the episodes are not recorded: {error}", Notice, stacklevel=3)
            yield recorder

    @contextlib.contextmanager
    def environment(self, render_mode: str | None = None) -> Iterator[BoundTask]:
        """Yield the task in a new environment with the running statistics of the training.

        `render_mode` is one of Gymnasium's, if pictures are needed.

        Raises:
            SerpError: The task cannot be loaded, or does not draw.
        """
        with self.task.bind(render_mode=render_mode) as task:
            with self.reading(self.checkpoint) as saved:
                environments = Saved("run", {}, saved.part("environments")[1])
                task.restore_environment(environments.part("0")[1], statistics_only=True)
            yield task
