"""Runs: training into a folder, continuing it, and using what came out."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Literal, NamedTuple

import numpy as np
import threadpoolctl
import torch
from numpy.typing import NDArray

from serp.agent import Agent
from serp.arbiter import Decision
from serp.domain.loading import Domain, load_domain
from serp.errors import RunError, SerpError, SettingsError
from serp.evaluation import EvaluationResult, Policy, evaluate
from serp.progress import ProgressStats, open_progress
from serp.registry import find_task, load_task
from serp.runs.checkpoint import NEWEST, PREVIOUS
from serp.runs.config import CONFIG
from serp.runs.folder import METRICS, RunFolder
from serp.runs.placement import default_path
from serp.runs.reading import read_metrics
from serp.runs.tensorboard import EventWriter, require_tensorboard
from serp.settings import Settings, resolve
from serp.task import BoundTask, Task
from serp.training import Trainer


class Interrupted(SerpError):
    """The user stopped a training; the run can be continued."""


def plan_and_learn(
    task: Task | str,
    *,
    preset: str = "default",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    episodes: int | None = None,
    env_steps: int | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    resume: bool = False,
    quiet: bool = False,
) -> Run:
    """Train on a task: the planner acts from the first step, the learner takes over.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one.
        preset: `default` or `paper`.
        settings: Section → setting → value, over preset and task; see `serp.Settings`.
        episodes: Train until so many episodes have ended since the run began.
        env_steps: Train until so many env steps are done; the episode that reaches the number is
            finished. With neither, a resumed run goes on to the budget that it began with, and
            for a new one `training.env_steps` of the settings counts.
        seed: Seed of everything random.
        out: Folder of the run; by default `runs/<domain>-<time>`.
        resume: Continue the run in `out` with its own domain, settings and seed; the continued
            run equals one that was never interrupted.
        quiet: Show no progress.

    Returns:
        The finished run.

    Raises:
        SerpError: Domain, task, settings or folder are wrong, or the environment failed.
        Interrupted: Ctrl-C; what was done is saved and can be resumed.
    """
    if (episodes is not None and episodes < 1) or (env_steps is not None and env_steps < 1):
        raise RunError("the budget (episodes, env steps) must be at least 1")
    if seed < 0:
        raise SettingsError(f"the seed must be 0 or more, not {seed}")
    if resume:
        if out is None:
            raise RunError("to resume, name the run's folder (--out RUN)")
        folder = RunFolder.open(out, writing=True)
        with folder:
            if isinstance(task, str):  # its domain is the run's own, whatever the file says now
                task = load_task(_made_with(folder).task)
            return _continue(folder, task, episodes, env_steps, quiet=quiet)
    if isinstance(task, str):
        task = find_task(task)
    bound = task.bind()
    resolved = resolve(preset, task.settings, settings)
    if resolved.training.tensorboard:
        require_tensorboard()
    path = Path(out) if out is not None else default_path(bound.name)
    config = {
        "task": bound.name,
        "domain": bound.domain.name,
        "preset": preset,
        "seed": seed,
        "reward": bound.rewarded_by,
        "control_period": task.dt,
        "budget": {"episodes": episodes, "env_steps": env_steps},
        "settings": resolved.as_dict(),
    }
    sources = [(s.name, s.text) for s in _sources(bound.domain)]
    with RunFolder.create(path, config, sources, command=tuple(sys.argv)) as folder:
        trainer = Trainer(bound, resolved, seed, folder.decisions)
        return _train(folder, trainer, episodes, env_steps, quiet=quiet)


def _sources(domain: Domain) -> list[Any]:
    return [s for s in (domain.source, domain.problem_source) if s is not None]


def _continue(
    folder: RunFolder, task: Task, episodes: int | None, env_steps: int | None, *, quiet: bool
) -> Run:
    made = _made_with(folder)
    if made.settings.training.tensorboard:
        require_tensorboard()
    trainer = Trainer(_task_of(folder, task).bind(), made.settings, made.seed, folder.decisions)
    budget = [made.episodes, made.env_steps]
    note = None
    if not _never_began(folder):
        checkpoint = folder.resume()
        trainer.load_state_dict(checkpoint.arrays, checkpoint.meta)
        budget = checkpoint.meta["budget"]
        note = checkpoint.fallback
    if episodes is None and env_steps is None:
        episodes, env_steps = budget
    return _train(folder, trainer, episodes, env_steps, quiet=quiet, note=note)


def _never_began(folder: RunFolder) -> bool:
    """Whether the run was stopped before its first checkpoint, which precedes all learning."""
    return not (
        (folder.path / NEWEST).exists()
        or (folder.path / PREVIOUS).exists()
        or len(read_metrics(folder.path / METRICS)["episode"])
    )


class _MadeWith(NamedTuple):
    """What a run was made with, as its `config.json` says."""

    task: str
    seed: int
    reward: Literal["domain", "environment"]
    dt: float
    settings: Settings
    episodes: int | None
    env_steps: int | None


def _made_with(folder: RunFolder) -> _MadeWith:
    """Read a run's configuration.

    Raises:
        RunError: Something is missing in it, or of the wrong kind.
    """
    config = folder.config
    try:
        if config["reward"] not in ("domain", "environment"):
            raise ValueError(f"reward is {config['reward']!r}")
        return _MadeWith(
            task=str(config["task"]),
            seed=int(config["seed"]),
            reward=config["reward"],
            dt=float(config["control_period"]),
            settings=Settings.from_dict(config["settings"]),
            episodes=_count(config["budget"]["episodes"]),
            env_steps=_count(config["budget"]["env_steps"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, SettingsError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(
            f"{folder.path / CONFIG} was changed or damaged: {what}; restore it from a copy"
        ) from error


def _count(value: Any) -> int | None:
    return None if value is None else int(value)


def _task_of(folder: RunFolder, task: Task) -> Task:
    """Return the task as the run has it, whatever became of its domain file since.

    Raises:
        RunError: The run is one of another task.
    """
    made = _made_with(folder)
    if task.name not in (None, made.task):
        raise RunError(f"{folder.path} is a run of task {made.task}, not of {task.name}")
    domain = load_domain(folder.domain_file, folder.problem_file)
    return dataclasses.replace(
        task, domain=domain, problem=None, name=made.task, reward=made.reward, dt=made.dt
    )


def _train(
    folder: RunFolder,
    trainer: Trainer,
    episodes: int | None,
    env_steps: int | None,
    *,
    quiet: bool,
    note: str | None = None,
) -> Run:
    settings = trainer.settings.training
    if episodes is None and env_steps is None:
        env_steps = settings.env_steps
    progress = open_progress(
        title=f"{trainer.task.name} → {folder.path}",
        episodes=episodes,
        env_steps=env_steps,
        start=_stats(trainer),
        quiet=quiet,
    )

    def save() -> float:
        """Save a checkpoint; return when the next one is due, so that they cost 2 % at most."""
        begun = trainer.wall_time
        arrays, meta = trainer.state_dict()
        folder.save_checkpoint(arrays, {**meta, "budget": [episodes, env_steps]})
        if events is not None:
            events.flush()
        cost = trainer.wall_time - begun
        return trainer.wall_time + min(settings.checkpoint_seconds, 50 * cost)

    events = EventWriter(folder.path, trainer.env_steps + 1) if settings.tensorboard else None
    trainer.on_step = lambda: progress.update(_stats(trainer)) if progress.due() else None
    with (
        contextlib.closing(trainer.task),
        _one_thread(),
        _stop_between_episodes() as stopping,
        progress,
    ):
        if note is not None:
            progress.note(note)
        # Whatever happens in the first episodes, the run can be continued.
        due = save()
        while not _done(trainer, episodes, env_steps) and not stopping.is_set():
            row = trainer.run_episode()
            folder.metrics.append(row)
            if events is not None:
                events.append(row)
            progress.update(_stats(trainer))
            if trainer.wall_time >= due:
                due = save()
        save()
    if events is not None:
        events.close()
    from serp.runs.results import write_results  # brings matplotlib, which no step needs

    write_results(folder)
    if stopping.is_set() and not _done(trainer, episodes, env_steps):
        raise Interrupted(
            f"stopped after {trainer.episode} episodes, {trainer.env_steps} env steps; everything "
            f"is saved in {folder.path}"
        )
    return Run(folder.path, trainer.task.task)


def _done(trainer: Trainer, episodes: int | None, env_steps: int | None) -> bool:
    return (episodes is not None and trainer.episode >= episodes) or (
        env_steps is not None and trainer.env_steps >= env_steps
    )


def _stats(trainer: Trainer) -> ProgressStats:
    recent = trainer.recent
    return ProgressStats(
        episode=trainer.episode,
        env_steps=trainer.env_steps,
        last_return=recent[-1] if recent else None,
        mean_return=float(np.mean(recent)) if recent else None,
        rho=trainer.agent.arbiter.rho,
        vetoes=trainer.vetoes,
        unsafe_executed=trainer.unsafe_executed,
    )


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Keep torch and BLAS to one thread: threads cost more than they bring in small networks."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpoolctl.threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


@contextlib.contextmanager
def _stop_between_episodes() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into a request to stop after the episode.

    A second one stops at once; the run then goes on from its last checkpoint.
    """
    stopping = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return
    before = signal.getsignal(signal.SIGINT)

    def request(number: int, frame: FrameType | None) -> None:
        stopping.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, request)
    try:
        yield stopping
    finally:
        signal.signal(signal.SIGINT, before)


def load_run(folder: str | Path, task: Task | None = None) -> Run:
    """Open a run.

    Args:
        folder: The run's folder.
        task: The task it was trained on; by default the installed task of that name.

    Raises:
        RunError: It is no run, or a file of it is damaged.
        TaskError: The task is not installed here.
    """
    opened = RunFolder.open(folder)
    if task is None:
        task = load_task(_made_with(opened).task)
    return Run(Path(folder), _task_of(opened, task))


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
            RunError: There is no whole checkpoint.
        """
        folder = RunFolder.open(self.path)
        made, checkpoint = _made_with(folder), folder.load_checkpoint()
        agent = Agent(self._bound, made.settings, made.seed)
        agent.load_state_dict(checkpoint.arrays, checkpoint.meta["agent"])
        return agent

    @functools.cached_property
    def _bound(self) -> BoundTask:
        return self.task.bind()

    def decide(self, observation: Any) -> Decision:
        """Decide as the trained agent does, for one observation as the environment gives it."""
        return self.agent.decide_greedily(*self.agent.perceive(observation))

    def evaluate(
        self, policy: Policy = "serp", *, episodes: int = 20, seed: int = 0
    ) -> EvaluationResult:
        """Evaluate a policy of the run; see `serp.evaluation.evaluate`.

        Raises:
            SerpError: The run or its task cannot be loaded, or the environment failed.
        """
        agent = self.agent
        # An environment of its own: what an evaluation leaves behind must not reach the next.
        with contextlib.closing(self.task.bind()) as task, _one_thread():
            return evaluate(agent, task, policy, episodes=episodes, seed=seed)
