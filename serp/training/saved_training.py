"""A training that is saved in a run folder: begun or continued, stopped and resumed."""

from __future__ import annotations

import contextlib
import shlex
import warnings
from collections.abc import Iterator

from serp._util.text import plural
from serp._util.threads import one_thread
from serp.control.step_record import StepRecord
from serp.errors import Interrupted, Notice, SettingsError
from serp.model.transition_model import StateError
from serp.runs.checkpoint import NEWEST, PREVIOUS
from serp.runs.folder import METRICS, RunFolder
from serp.runs.reading import read_metrics
from serp.runs.recorder import Recorder
from serp.runs.recording_format import RECORDING, Layout
from serp.runs.tensorboard import EventWriter, require_tensorboard
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import describe_source
from serp.tasks.watchdog import Watchdog
from serp.training.account import account_of
from serp.training.budget import Budget
from serp.training.callbacks import Callbacks
from serp.training.compile_progress import show_compiling
from serp.training.progress import Progress
from serp.training.run import Run, reading
from serp.training.run_metadata import content_digests, read_run_metadata, refuse_changes
from serp.training.stopping import stop_between_episodes
from serp.training.trainer import Trainer


def compiled_trainer(task: BoundTask, settings: Settings, seed: int, *, quiet: bool) -> Trainer:
    """Return a trainer whose loops are compiled."""
    with show_compiling(quiet=quiet):
        trainer = Trainer(task, settings, seed)
        try:
            trainer.prepare()
        except BaseException:
            trainer.close()
            raise
    return trainer


def continue_training(
    folder: RunFolder, task: BoundTask, budget: Budget, callbacks: Callbacks, *, quiet: bool
) -> Run:
    """Continue a run from its newest checkpoint, as if it had not been interrupted."""
    made = read_run_metadata(folder)
    if made.settings.training.tensorboard:
        require_tensorboard()
    with compiled_trainer(task, made.settings, made.seed, quiet=quiet) as trainer:
        before = _restore(folder, trainer, made.budget)
        limits = budget if budget.limits else before
        return train(folder, trainer, limits, callbacks, quiet=quiet)


def _restore(folder: RunFolder, trainer: Trainer, before: Budget) -> Budget:
    """Restore the newest checkpoint, if there is one; return the budget of the run."""
    # A run without a checkpoint and without an episode was stopped before it began.
    if _has_checkpoint(folder) or len(read_metrics(folder.path / METRICS)["episode"]):
        checkpoint = folder.resume()
        refuse_changes(folder, checkpoint)
        with reading(checkpoint) as saved:
            trainer.load_state_dict(checkpoint.arrays, checkpoint.meta)
            before = Budget.from_dict(saved.part("budget")[1])
        if checkpoint.fallback is not None:
            warnings.warn(
                f"{checkpoint.fallback} The run goes on from the previous checkpoint, after "
                f"{plural(trainer.env_steps, 'env step')}; what came after it is done again.",
                Notice,
                stacklevel=4,
            )
    return before


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


def train(
    folder: RunFolder,
    trainer: Trainer,
    budget: Budget,
    callbacks: Callbacks,
    *,
    quiet: bool,
) -> Run:
    """Train until the budget is spent, a signal is received or a callback fails."""
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
        if trainer.recorder is not None:
            trainer.recorder.flush()
        folder.save_checkpoint(arrays, {**meta, "budget": budget.as_dict(), "made_of": digests})
        if events is not None:
            events.flush()
        cost = trainer.wall_time - begun
        return trainer.wall_time + min(settings.checkpoint_seconds, 50 * cost)

    with _advice_to_resume(folder), stop_between_episodes() as stopping:

        def after_step(step: StepRecord) -> None:
            answer = stopping.answer(
                "the episode" if len(trainer.lanes) == 1 else "the episodes",
                "the run then continues from its last checkpoint",
            )
            if answer is not None:
                progress.answer(answer)
            if events is not None and settings.tensorboard == "steps":
                events.append_step(trainer.under_way, step)
            callbacks.step(step)
            progress.refresh()

        trainer.on_step = after_step
        with contextlib.ExitStack() as stack, one_thread(), progress, watchdog:
            if settings.record:
                layout = Layout.of(trainer.task.model, trainer.task.actions)
                recorder = Recorder(folder.path / RECORDING, layout, trainer.env_steps)
                trainer.recorder = stack.enter_context(recorder)
            if settings.tensorboard:
                events = stack.enter_context(EventWriter(folder.path, trainer.env_steps + 1))
            task = trainer.task
            source = describe_source(
                trainer.judge.source,
                in_file=task.model.rewarding,
                world=task.task.world is not None,
            )
            for note in (f"The learner learns from {source}.", *trainer.agent.notices):
                progress.note(note)
            if budget.spent_by(trainer):
                progress.note(
                    f"Nothing is left to do after {trainer.env_steps} env steps; to train on, give "
                    f"a larger budget in all, such as --env-steps {2 * trainer.env_steps}."
                )
            else:
                # A failure in the first episodes must not prevent a continuation.
                due = save()
            while not (budget.spent_by(trainer) or stopping.requested or callbacks.failure):
                for row in trainer.run():
                    folder.metrics.append(row)
                    if events is not None:
                        events.append(row)
                    callbacks.episode(row)
                if trainer.wall_time >= due:
                    due = save()
            if trainer.env_steps > before:
                save()
        from serp.runs.results import write_results  # imports matplotlib, which steps do not need

        account = account_of(trainer.agent)
        write_results(folder, compile_seconds=trainer.compile_seconds, account=account)
        if callbacks.failure is not None:
            raise callbacks.failure
        if stopping.signal is not None and not budget.spent_by(trainer):
            raise Interrupted(
                f"stopped after {trainer.episode} episodes, {trainer.env_steps} env steps; "
                f"everything is saved in {folder.path}.",
                stopping.signal,
            )
    return Run(folder.path, trainer.task.task)
