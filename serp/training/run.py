"""Runs: training into a folder, continuing it, and using what came out."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import functools
import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import seed_of, whole
from serp._util.saved_state import Saved
from serp._util.terminal import bar
from serp._util.threads import one_thread
from serp.control.decision import Decision
from serp.control.step_record import StepRecord
from serp.errors import Interrupted, RunError, SettingsError, TaskError
from serp.model.loading import Domain, load_domain
from serp.model.transition_model import StateError
from serp.runs.checkpoint import NEWEST, PREVIOUS, Checkpoint
from serp.runs.folder import METRICS, RunFolder
from serp.runs.placement import default_path
from serp.runs.reading import read_metrics
from serp.runs.tensorboard import EventWriter, require_tensorboard
from serp.settings import Settings, resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import find_task, load_task
from serp.tasks.reward import describe_source, reward_source
from serp.tasks.task import Task
from serp.tasks.watchdog import Watchdog
from serp.training.agent import Agent
from serp.training.budget import Budget
from serp.training.compile_progress import show_compiling
from serp.training.evaluation import EPISODES, EvaluationResult, evaluate
from serp.training.policies import Policy
from serp.training.progress import ProgressStats
from serp.training.progress_display import open_progress
from serp.training.run_metadata import content_digests, read_run_metadata, refuse_changes
from serp.training.stopping import stop_between_episodes
from serp.training.trainer import Trainer


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
            for a new one `training.units` or `training.env_steps` of the settings counts.
        seed: Seed of everything random.
        out: Folder of the run; by default `runs/<domain>-<time>`.
        resume: Continue the run in `out` with its own domain, settings and seed; the continued
            run equals one that was never interrupted.
        quiet: Show no progress.

    Returns:
        The finished run.

    Raises:
        SerpError: Domain, task, settings or folder are wrong, or the environment failed.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; what was done is saved and can be resumed.
    """
    begun = datetime.datetime.now()
    budget = Budget(episodes=episodes, env_steps=env_steps)
    seed = seed_of(seed)
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    if not isinstance(task, Task | str):
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    if resume:
        if out is None:
            raise RunError("to resume, name the run's folder (--out RUN)")
        folder = RunFolder.open(out, writing=True)
        with folder:
            if isinstance(task, str):  # its domain is the run's own, whatever the file says now
                task = load_task(read_run_metadata(folder).task)
            with _task_of(folder, task).bind() as bound:
                return _continue(folder, bound, budget, quiet=quiet)
    if isinstance(task, str):
        task = find_task(task)
    resolved = resolve(preset, task.settings, settings)
    if resolved.training.tensorboard:
        require_tensorboard()
    with task.bind() as bound:
        path = Path(out) if out is not None else default_path(bound.name, begun)
        config = {
            "task": bound.name,
            "domain": bound.domain.name,
            "observed": sorted(bound.domain.supplied or ()),
            "max_ground_schemas": bound.domain.max_ground_schemas,
            "preset": preset,
            "seed": seed,
            "reward": bound.rewarded_by,
            "learned_from": reward_source(bound.rewarded_by, resolved),
            "file_rewards": bound.model.rewarding,
            "control_period": bound.model.dt,
            "budget": budget.as_dict(),
            "settings": resolved.as_dict(),
        }
        sources = [(s.name, s.text) for s in _sources(bound.domain)]
        trainer = _trainer(bound, resolved, seed, quiet=quiet)
        command = tuple(sys.argv)
        with RunFolder.create(path, config, sources, command=command, now=begun) as folder:
            trainer.decisions = folder.decisions
            with _advice_to_resume(folder):
                return _train(folder, trainer, budget, quiet=quiet)


def _trainer(task: BoundTask, settings: Settings, seed: int, *, quiet: bool) -> Trainer:
    """Return a trainer that has nothing left to compile."""
    with show_compiling(quiet=quiet):
        trainer = Trainer(task, settings, seed)
        trainer.prepare()
    return trainer


def _sources(domain: Domain) -> list[Any]:
    return [s for s in (domain.source, domain.problem_source) if s is not None]


def _continue(folder: RunFolder, task: BoundTask, budget: Budget, *, quiet: bool) -> Run:
    made = read_run_metadata(folder)
    if made.settings.training.tensorboard:
        require_tensorboard()
    trainer = _trainer(task, made.settings, made.seed, quiet=quiet)
    trainer.decisions = folder.decisions
    before = made.budget
    note = None
    if not _never_began(folder):
        checkpoint = folder.resume()
        refuse_changes(folder, checkpoint)
        with _read_from(checkpoint) as saved:
            trainer.load_state_dict(checkpoint.arrays, checkpoint.meta)
            before = Budget.from_dict(saved.part("budget")[1])
        note = checkpoint.fallback
    if not budget.given:
        budget = before
    with _advice_to_resume(folder):
        return _train(folder, trainer, budget, quiet=quiet, note=note)


@contextlib.contextmanager
def _advice_to_resume(folder: RunFolder) -> Iterator[None]:
    """Add to whatever stops a training how it goes on, where it can.

    Settings and domain cannot change in a run, so where one of them is wrong there is nothing to
    go on with.
    """
    try:
        yield
    except (SettingsError, StateError):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if any((folder.path / name).exists() for name in (NEWEST, PREVIOUS)):
            kept = f"What was done up to the last checkpoint is kept in {folder.path}. "
            error.add_note(
                f"{'' if isinstance(error, Interrupted) else kept}Continue with\n"
                f"  serp plan-and-learn --resume {shlex.quote(str(folder.path))}\n"
                f"or, in Python, plan_and_learn(task, out={str(folder.path)!r}, resume=True)"
            )
        raise


@contextlib.contextmanager
def _read_from(checkpoint: Checkpoint) -> Iterator[Saved]:
    """Give what a checkpoint says; an error about it names the file."""
    try:
        yield Saved("run", {}, checkpoint.meta)
    except (RunError, SettingsError) as error:
        raise RunError(f"{checkpoint.path}: {error}") from error


def _never_began(folder: RunFolder) -> bool:
    """Whether the run was stopped before its first checkpoint, which precedes all learning."""
    return not (
        (folder.path / NEWEST).exists()
        or (folder.path / PREVIOUS).exists()
        or len(read_metrics(folder.path / METRICS)["episode"])
    )


def _task_of(folder: RunFolder, task: Task) -> Task:
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


def _train(
    folder: RunFolder,
    trainer: Trainer,
    budget: Budget,
    *,
    quiet: bool,
    note: str | None = None,
) -> Run:
    settings = trainer.settings.training
    if not budget.given:
        # A number of units, where the task or the user sets one, stands for the steps.
        units = settings.units
        budget = Budget(units=units) if units else Budget(env_steps=settings.env_steps)
    digests = content_digests(folder)
    progress = open_progress(
        title=f"{trainer.task.name} → {folder.path}",
        budget=budget,
        unit=trainer.settings.arbiter.rho_unit,
        start=_stats(trainer, trainer.wall_time),
        quiet=quiet,
    )

    def save() -> float:
        """Save a checkpoint; return when the next one is due, so that they cost 2 % at most."""
        begun = trainer.wall_time
        arrays, meta = trainer.state_dict()
        folder.save_checkpoint(arrays, {**meta, "budget": budget.as_dict(), "made_of": digests})
        if events is not None:
            events.flush()
        cost = trainer.wall_time - begun
        return trainer.wall_time + min(settings.checkpoint_seconds, 50 * cost)

    def after_step(step: StepRecord) -> None:
        answer = stopping.answer("the episode", "the run then continues from its last checkpoint")
        if answer is not None:
            progress.answer(answer)
        if progress.due():
            progress.update(_stats(trainer, trainer.wall_time))

    trainer.on_step = after_step
    trainer.task.on_notice = progress.note
    watchdog = Watchdog(
        trainer.task, settings.slow_step_seconds, lambda: trainer.under_way, progress.note
    )
    events: EventWriter | None = None
    with stop_between_episodes() as stopping:
        with contextlib.ExitStack() as stack, one_thread(), progress, watchdog:
            if settings.tensorboard:
                events = stack.enter_context(EventWriter(folder.path, trainer.env_steps + 1))
            source = describe_source(trainer.judge.source, in_file=trainer.task.model.rewarding)
            said = f"The learner learns from {source}."
            for text in (note, said, *trainer.agent.notices):
                if text is not None:
                    progress.note(text)
            # Whatever happens in the first episodes, the run can be continued.
            due = save()
            while not budget.spent_by(trainer) and not stopping.requested:
                row = trainer.run_episode()
                folder.metrics.append(row)
                if events is not None:
                    events.append(row)
                progress.update(_stats(trainer, row.wall_time))
                if trainer.wall_time >= due:
                    due = save()
            save()
        from serp.runs.results import write_results  # brings matplotlib, which no step needs

        write_results(folder, compile_seconds=trainer.compile_seconds)
    if stopping.signal is not None and not budget.spent_by(trainer):
        raise Interrupted(
            f"stopped after {trainer.episode} episodes, {trainer.env_steps} env steps; everything "
            f"is saved in {folder.path}.",
            stopping.signal,
        )
    return Run(folder.path, trainer.task.task)


def _stats(trainer: Trainer, wall_time: float) -> ProgressStats:
    recent = trainer.recent
    return ProgressStats(
        episode=trainer.episode,
        env_steps=trainer.env_steps,
        units=trainer.units,
        last_return=recent[-1] if recent else None,
        mean_return=float(np.mean(recent)) if recent else None,
        rho=trainer.agent.strategy.rho,
        vetoes=trainer.tally.vetoes,
        unsafe_executed=trainer.tally.unsafe_executed,
        wall_time=wall_time,
    )


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
            RunError: There is no whole checkpoint, or the run's files were changed since.
        """
        checkpoint = self._checkpoint
        folder = RunFolder.open(self.path)
        refuse_changes(folder, checkpoint)
        made = read_run_metadata(folder)
        # What the agent has to know of the environment outlives it.
        with self.task.bind() as bound:
            agent = Agent(bound, made.settings, made.seed)
        with _read_from(checkpoint) as saved:
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

        This is `serp` of `serp.training.policies.Policy`.

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
        """Evaluate a policy of the run; see `serp.training.evaluation.evaluate`.

        Args:
            policy: Which; see `serp.training.policies.Policy`.
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
            with _read_from(self._checkpoint) as saved:
                task.restore_environment(saved.part("environment")[1], statistics_only=True)
            yield task
