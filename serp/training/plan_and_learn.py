"""`plan_and_learn`: trains into a run folder, or continues a run."""

from __future__ import annotations

import contextlib
import datetime
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from serp._util.numbers import seed_of
from serp._util.threads import one_thread
from serp.control.step_record import StepRecord
from serp.errors import Interrupted, RunError, SettingsError, TaskError
from serp.model.transition_model import StateError
from serp.runs.checkpoint import NEWEST, PREVIOUS
from serp.runs.config import CONFIG
from serp.runs.folder import METRICS, RunFolder
from serp.runs.new_folder import default_path, occupied
from serp.runs.reading import read_metrics
from serp.runs.tensorboard import EventWriter, require_tensorboard
from serp.settings import Settings, resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import find_task, load_task
from serp.tasks.reward import describe_source, reward_source
from serp.tasks.task import Task
from serp.tasks.watchdog import Watchdog
from serp.training.account import account_of
from serp.training.budget import Budget
from serp.training.compile_progress import show_compiling
from serp.training.progress import Progress
from serp.training.run import Run, reading, task_of_run
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
        settings: Section → setting → value; overrides preset and task; see `serp.Settings`.
        episodes: Number of episodes since the run began after which it ends.
        env_steps: Number of env steps since the run began after which it ends; the episode that
            reaches it is finished. With neither, a resumed run continues to its own budget, and a
            new run ends after `training.units` or `training.env_steps` of the settings.
        seed: Seed of everything random.
        out: Folder of the run; by default `runs/<domain>-<time>`.
        resume: Continue the run in `out` with its own domain, settings and seed; the continued
            run equals one that was never interrupted.
        quiet: Show no progress.

    Returns:
        The finished run.

    Raises:
        SerpError: Domain, task, settings or folder are wrong, or the environment failed.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the run is saved and can be resumed.
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
            if isinstance(task, str):  # the run has its own copy of the domain
                task = load_task(read_run_metadata(folder).task)
            with task_of_run(folder, task).bind() as bound:
                return _continue(folder, bound, budget, quiet=quiet)
    if isinstance(task, str):
        task = find_task(task)
    resolved = resolve(preset, task.settings, settings)
    if resolved.training.tensorboard:
        require_tensorboard()
    with task.bind() as bound:
        path = Path(out) if out is not None else default_path(bound.name, begun)
        if os.path.lexists(path / CONFIG):  # said before anything is compiled
            raise occupied(path)
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
        files = (bound.domain.source, bound.domain.problem_source)
        sources = [(file.name, file.text) for file in files if file is not None]
        trainer = _trainer(bound, resolved, seed, quiet=quiet)
        with RunFolder.create(path, config, sources, command=sys.argv, now=begun) as folder:
            return _train(folder, trainer, budget, quiet=quiet)


def _trainer(task: BoundTask, settings: Settings, seed: int, *, quiet: bool) -> Trainer:
    """Return a trainer whose loops are compiled."""
    with show_compiling(quiet=quiet):
        trainer = Trainer(task, settings, seed)
        trainer.prepare()
    return trainer


def _continue(folder: RunFolder, task: BoundTask, budget: Budget, *, quiet: bool) -> Run:
    made = read_run_metadata(folder)
    if made.settings.training.tensorboard:
        require_tensorboard()
    trainer = _trainer(task, made.settings, made.seed, quiet=quiet)
    before, notes = made.budget, []
    # A run without a checkpoint and without an episode was stopped before it began.
    if _has_checkpoint(folder) or len(read_metrics(folder.path / METRICS)["episode"]):
        checkpoint = folder.resume()
        refuse_changes(folder, checkpoint)
        with reading(checkpoint) as saved:
            trainer.load_state_dict(checkpoint.arrays, checkpoint.meta)
            before = Budget.from_dict(saved.part("budget")[1])
        if checkpoint.fallback is not None:
            notes = [checkpoint.fallback]
    return _train(folder, trainer, budget if budget.limits else before, quiet=quiet, notes=notes)


def _has_checkpoint(folder: RunFolder) -> bool:
    return any((folder.path / name).exists() for name in (NEWEST, PREVIOUS))


@contextlib.contextmanager
def _advice_to_resume(folder: RunFolder) -> Iterator[None]:
    """Add to any error of a training how to continue it, if that is possible.

    Settings and domain cannot change in a run, so a run with a wrong one cannot be continued.
    """
    try:
        yield
    except (SettingsError, StateError):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if _has_checkpoint(folder):
            kept = f"The run up to the last checkpoint is kept in {folder.path}. "
            error.add_note(
                f"{'' if isinstance(error, Interrupted) else kept}Continue with\n"
                f"  serp plan-and-learn --resume {shlex.quote(str(folder.path))}\n"
                f"or, in Python, plan_and_learn(task, out={str(folder.path)!r}, resume=True)"
            )
        raise


def _train(
    folder: RunFolder,
    trainer: Trainer,
    budget: Budget,
    *,
    quiet: bool,
    notes: Sequence[str] = (),
) -> Run:
    """Train until the budget is spent or a signal is received."""
    settings = trainer.settings.training
    trainer.decisions = folder.decisions
    if not budget.limits:
        # A number of units, if the task or the user sets one, replaces the number of steps.
        units = settings.units
        budget = Budget(units=units) if units else Budget(env_steps=settings.env_steps)
    before = trainer.env_steps
    digests = content_digests(folder)
    progress = Progress(trainer, budget, f"{trainer.task.name} → {folder.path}", quiet=quiet)
    trainer.task.on_notice = progress.note
    watchdog = Watchdog(
        trainer.task, settings.slow_step_seconds, lambda: trainer.under_way, progress.note
    )
    events: EventWriter | None = None

    def save() -> float:
        """Save a checkpoint; return when the next is due, so that checkpoints cost at most 2 %."""
        begun = trainer.wall_time
        arrays, meta = trainer.state_dict()
        folder.save_checkpoint(arrays, {**meta, "budget": budget.as_dict(), "made_of": digests})
        if events is not None:
            events.flush()
        cost = trainer.wall_time - begun
        return trainer.wall_time + min(settings.checkpoint_seconds, 50 * cost)

    with _advice_to_resume(folder), stop_between_episodes() as stopping:

        def after_step(step: StepRecord) -> None:
            answer = stopping.answer(
                "the episode", "the run then continues from its last checkpoint"
            )
            if answer is not None:
                progress.answer(answer)
            progress.refresh()

        trainer.on_step = after_step
        with contextlib.ExitStack() as stack, one_thread(), progress, watchdog:
            if settings.tensorboard:
                events = stack.enter_context(EventWriter(folder.path, trainer.env_steps + 1))
            source = describe_source(trainer.judge.source, in_file=trainer.task.model.rewarding)
            for note in (*notes, f"The learner learns from {source}.", *trainer.agent.notices):
                progress.note(note)
            if budget.spent_by(trainer):
                progress.note(
                    f"Nothing is left to do after {trainer.env_steps} env steps; to train on, give "
                    f"a larger budget in all, such as --env-steps {2 * trainer.env_steps}."
                )
            else:
                # A failure in the first episodes must not prevent a continuation.
                due = save()
            while not budget.spent_by(trainer) and not stopping.requested:
                row = trainer.run_episode()
                folder.metrics.append(row)
                if events is not None:
                    events.append(row)
                if trainer.wall_time >= due:
                    due = save()
            if trainer.env_steps > before:
                save()
        from serp.runs.results import write_results  # imports matplotlib, which steps do not need

        account = account_of(trainer.agent)
        write_results(folder, compile_seconds=trainer.compile_seconds, account=account)
        if stopping.signal is not None and not budget.spent_by(trainer):
            raise Interrupted(
                f"stopped after {trainer.episode} episodes, {trainer.env_steps} env steps; "
                f"everything is saved in {folder.path}.",
                stopping.signal,
            )
    return Run(folder.path, trainer.task.task)
