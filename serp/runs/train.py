"""`plan_and_learn`: trains into a run folder, or continues a run.

What the user gave is checked before the run folder is made.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Final

from serp._util.files import read_regular
from serp._util.numbers import seed_of
from serp._util.processes import one_thread
from serp.agent.agent import account_of
from serp.agent.registry import refuse_unknown_names
from serp.agent.step_record import OnStep, StepRecord
from serp.errors import Interrupted, RunError, SettingsError
from serp.model.transition_model import StateError
from serp.runs import checkpoint
from serp.runs.folder import DECISIONS, METRICS, default_path, refuse_occupied
from serp.runs.progress import Progress
from serp.runs.results import write_results
from serp.runs.run import Run
from serp.runs.run_config import Budget
from serp.runs.run_log import RunLog
from serp.runs.trainer import Callbacks, OnEpisode, Trainer
from serp.settings import entries, resolve
from serp.tasks.registry import find_task
from serp.tasks.task import Task

SIGNALS: Final[tuple[signal.Signals, ...]] = (
    signal.SIGINT,
    signal.SIGTERM,
    *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()),  # Windows has none
)
_ECHO: Final = 1.0
"""Seconds in which a repeated SIGTERM or SIGHUP counts as the same request, because `timeout`,
shells and schedulers send it to the process and to its group."""
CHECKPOINT_SECONDS: Final = 15.0
"""Longest time between two checkpoints; they are written between episodes."""


class StoppedAtOnce(KeyboardInterrupt):
    """A second signal was received; `signal` is its number."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.signal = number


class Stopping:
    """The state of a request to stop: `signal` is the number of the first signal, None for none."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._since, self._answered = 0.0, False

    @property
    def requested(self) -> bool:
        """Whether a signal was received."""
        return self.signal is not None

    def answer(self, finishing: str, otherwise: str) -> str | None:
        """Return, once after a signal, what is finished first and what a second would do."""
        if self.signal is None or self._answered:
            return None
        self._answered = True
        pressed = self.signal == signal.SIGINT
        name = "Ctrl-C" if pressed else signal.Signals(self.signal).name
        again = "Press it again" if pressed else "Send another signal"
        return f"{name}: finishing {finishing}. {again} to stop at once; {otherwise}."

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal; raise `StoppedAtOnce` if it is not the first."""
        now = time.monotonic()
        if self.signal is None:
            self.signal, self._since = number, now
        elif number == signal.SIGINT or number != self.signal or now - self._since > _ECHO:
            raise StoppedAtOnce(number)


@contextlib.contextmanager
def stop_between_episodes() -> Iterator[Stopping]:
    """Turn the first signal into a request; a second one raises `StoppedAtOnce`.

    The handler itself shows nothing, because it may interrupt the display in the middle of a line;
    the training loop calls `answer` after every step. Outside the main thread no handler is set.
    Signals that are ignored (Ctrl-C in a background job, SIGHUP under `nohup`) or already handled
    are not changed either. A Python handler of Ctrl-C is replaced, but not one of this kind: a
    training within a comparison is stopped by the comparison.
    """
    stopping = Stopping()
    if threading.current_thread() is not threading.main_thread():
        yield stopping
        return
    before = {
        number: handler
        for number in SIGNALS
        if (handler := signal.getsignal(number)) not in (None, signal.SIG_IGN)
        and (number == signal.SIGINT or handler is signal.SIG_DFL)
        and not isinstance(getattr(handler, "__self__", None), Stopping)
    }
    try:
        for number in before:
            signal.signal(number, stopping.hear)
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def restore(run: Run, trainer: Trainer, before: Budget) -> Budget:
    """Restore the checkpoint, if there is one; return the budget of the run."""
    if "policy" in run.config:
        raise RunError(
            f"{run.path} is an exported policy; continue the run that it was exported from"
        )
    metrics = run.path / METRICS
    # A run without a checkpoint and without an episode was stopped before it began, perhaps before
    # the table had its header.
    if run.has_checkpoint or (metrics.exists() and read_regular(metrics).count(b"\n") > 1):
        saved = run.read_checkpoint()
        with run.reading(saved) as values:
            trainer.load_state_dict(*saved)
            before = Budget(**dict(entries(values.part("budget")[1], "budget", "{}")))
            for name in (METRICS, DECISIONS):
                run.table(name, saved)
    return before


@contextlib.contextmanager
def advice_to_resume(run: Run) -> Iterator[None]:
    """Add to any error of a training how to continue it, if that is possible.

    Settings and domain cannot change in a run, so a run with a wrong one cannot be continued.
    """
    try:
        yield
    except (SettingsError, StateError):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if run.has_checkpoint:
            kept = f"The run up to the last checkpoint is kept in {run.path}. "
            error.add_note(
                f"{'' if isinstance(error, Interrupted) else kept}Continue with\n"
                f"  serp plan-and-learn --resume {shlex.quote(str(run.path))}\n"
                f"or, in Python, plan_and_learn(task, out={str(run.path)!r}, resume=True)"
            )
        raise


def train(run: Run, trainer: Trainer, budget: Budget, callbacks: Callbacks, *, quiet: bool) -> Run:
    """Train until the budget is spent, a signal is received or a callback fails."""
    if not budget.limits:
        budget = Budget(env_steps=trainer.settings.training.env_steps)
    before = trainer.env_steps
    digests = run.digests()
    progress = Progress(trainer, budget, f"{trainer.task.name} → {run.path}", quiet=quiet)
    trainer.task.on_notice = progress.note

    def save() -> float:
        """Save a checkpoint; return when the next is due, so that checkpoints cost at most 2 %."""
        begun = trainer.wall_time
        arrays, meta = trainer.state_dict()
        meta |= {"budget": budget.as_dict(), "made_of": digests, "tables": log.flush()}
        checkpoint.save(run.path / checkpoint.CHECKPOINT, arrays, meta)
        cost = trainer.wall_time - begun
        return trainer.wall_time + min(CHECKPOINT_SECONDS, 50 * cost)

    with advice_to_resume(run), stop_between_episodes() as stopping:

        def after_step(step: StepRecord) -> None:
            finishing = "the episode" if len(trainer.environments) == 1 else "the episodes"
            answer = stopping.answer(
                f"{finishing}, so that nothing is lost",
                "a resumed run then continues from its last checkpoint",
            )
            if answer is not None:
                progress.answer(answer)
            callbacks.step(step)
            progress.refresh()

        trainer.on_step = after_step
        log = RunLog(run.path, trainer.task, trainer.env_steps, trainer.episode)
        with log, one_thread(), progress:
            trainer.log = log
            progress.note(f"The learner learns from {run.learned_reward}.")
            longest = trainer.settings.training.episode_steps
            if longest > (budget.env_steps or longest) and not trainer.task.time_limited:
                text = f"an episode may take {longest:,} env steps (training.episode_steps)"
                progress.note(f"The environment declares no time limit, so {text}.")
            if trainer.agent.adaptation.notice is not None:
                progress.note(trainer.agent.adaptation.notice)
            if budget.spent_by(trainer):
                progress.note(
                    f"Nothing is left to do after {trainer.env_steps} env steps; to continue, give "
                    f"a larger total budget, such as --env-steps {2 * trainer.env_steps}."
                )
            else:
                # A failure in the first episodes must not prevent a continuation.
                due = save()
            while not (budget.spent_by(trainer) or stopping.requested or callbacks.failure):
                for row in trainer.run():
                    callbacks.episode(row)
                if trainer.wall_time >= due:
                    due = save()
            if trainer.env_steps > before:
                save()
        write_results(run, trainer.tally.vetoes_by_reason(), account_of(trainer.agent))
        if callbacks.failure is not None:
            raise callbacks.failure
        if stopping.signal is not None and not budget.spent_by(trainer):
            raise Interrupted(
                f"stopped after {trainer.episode} episodes, {trainer.env_steps} env steps; "
                f"everything is saved in {run.path}.",
                stopping.signal,
            )
    return run


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
    on_step: OnStep | None = None,
    on_episode: OnEpisode | None = None,
) -> Run:
    """Train on a task: the planner acts from the first step, the learner takes over.

    Args:
        task: The task, the name of an installed one, or a domain file: of an installed task, or
            one whose problem makes it a world, see `serp.file_task`.
        preset: `default` or `paper`.
        settings: Section → setting → value; overrides preset and task; see `serp.Settings`.
        episodes: Number of episodes since the run began after which it ends.
        env_steps: Number of env steps since the run began after which it ends; the episode that
            reaches it is finished. With neither, a resumed run continues to its own budget, and a
            new run ends after `training.env_steps` of the settings.
        seed: Seed of everything random.
        out: Folder of the run; by default `runs/<domain>-<time>`.
        resume: Continue the run in `out` with its own domain, settings and seed; the continued
            run equals one that was never interrupted.
        quiet: Show no progress.
        on_step: Called with the `StepRecord` of every env step, after learning from it; must not
            change it. If it raises, the episode is finished, the run is saved, and the error is
            raised.
        on_episode: Called with the metrics (`MetricsRow`) of every new episode; see `on_step`.

    Returns:
        The finished run.

    Raises:
        SerpError: Domain, task, settings or folder are wrong, or the environment failed.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the run is saved and can be resumed.
    """
    budget = Budget(episodes=episodes, env_steps=env_steps)
    callbacks = Callbacks(on_step, on_episode)
    seed = seed_of(seed)
    if not isinstance(out, str | os.PathLike | None) or "\0" in str(out):
        raise SettingsError(f"out must be the name of a folder, not {out!r}")
    if resume:
        if out is None:
            raise RunError("to resume, name the run's folder (--out RUN)")
        own = None if isinstance(task, str) else task
        with Run(Path(out), own).lock() as run, run.task.bind() as bound:
            made = run.made
            with Trainer(bound, made.settings, made.seed, baseline=made.baseline) as trainer:
                before = restore(run, trainer, made.budget)
                limits = budget if budget.limits else before
                return train(run, trainer, limits, callbacks, quiet=quiet)
    task = find_task(task)
    resolved = resolve(preset, task.settings, settings)
    refuse_unknown_names(resolved, task)
    if out is not None:
        refuse_occupied(Path(out))
    with task.bind() as bound:
        path = Path(out) if out is not None else default_path(bound.name)
        with (
            Trainer(bound, resolved, seed) as trainer,
            Run.begin(path, bound, resolved, preset=preset, seed=seed, budget=budget) as run,
        ):
            return train(run, trainer, budget, callbacks, quiet=quiet)
