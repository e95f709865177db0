"""The display of a running comparison: a bar on a terminal, one line per trial elsewhere."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Self

from rich.progress import BarColumn, Progress, TaskID, TextColumn

from serp._util.number_format import duration
from serp._util.terminal import open_console
from serp.comparison.trial_records import Trial


class RemainingTime:
    """Estimates the remaining time.

    It assumes the mean time per env step of the same algorithm so far, or of all algorithms if that
    is unknown.

    Args:
        trials: The trials to run.
        env_steps: Env steps of each trial.
        processes: Number of processes.
        clock: Monotonic clock, seconds.
    """

    def __init__(
        self,
        trials: Iterable[Trial],
        env_steps: int,
        processes: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._left = {trial: env_steps for trial in trials}
        self._env_steps = env_steps
        self._processes = processes
        self._clock = clock
        self._seen: dict[Trial, float] = {}
        self._steps: dict[str, int] = defaultdict(int)
        self._seconds: dict[str, float] = defaultdict(float)

    @property
    def share(self) -> float:
        """Share of all env steps that are done."""
        left = sum(self._left.values())
        return 1.0 - left / max(1, self._env_steps * len(self._left))

    def notice(self, trial: Trial, env_steps: int) -> None:
        """Record the env steps of a trial so far."""
        now = self._clock()
        before = self._left[trial]
        self._left[trial] = self._env_steps - min(env_steps, self._env_steps)
        if trial in self._seen and before > self._left[trial]:
            self._steps[trial.algorithm] += before - self._left[trial]
            self._seconds[trial.algorithm] += now - self._seen[trial]
        self._seen[trial] = now

    def end(self, trial: Trial, *, complete: bool) -> None:
        """Record the end of a trial; one that failed does not count for the speed."""
        if complete:
            self.notice(trial, self._env_steps)
        self._left[trial] = 0

    def seconds_left(self) -> float | None:
        """Return the estimate; None before the first measurement."""
        steps, seconds = sum(self._steps.values()), sum(self._seconds.values())
        if not steps:
            return None
        needed: list[float] = []
        for trial, left in self._left.items():
            name = trial.algorithm
            known = self._steps[name] > 0
            rate = self._seconds[name] / self._steps[name] if known else seconds / steps
            needed.append(left * rate)
        # A trial runs in one process.
        return max(sum(needed) / self._processes, *needed)


class Display:
    """Shows the progress of a comparison on standard error.

    Args:
        remaining: Estimates the remaining time.
        count: Number of trials.
        quiet: Show nothing.
    """

    def __init__(self, remaining: RemainingTime, count: int, *, quiet: bool) -> None:
        self._remaining = remaining
        self._count = count
        self._ended = 0
        self._quiet = quiet
        self._console = open_console(sys.stderr)
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> Self:
        if not self._quiet and self._console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.percentage:>3.0f} %  {task.fields[left]}"),
                console=self._console,
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task(self._where(), total=1.0, left="")
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bar is not None:
            with suppress(OSError, ValueError):
                self._bar.stop()

    def notice(self, trial: Trial, env_steps: int) -> None:
        """Show the env steps of a trial so far."""
        self._remaining.notice(trial, env_steps)
        self._show()

    def end(self, trial: Trial, error: str | None) -> None:
        """Show that a trial has ended."""
        self._remaining.end(trial, complete=error is None)
        self._ended += 1
        how = "" if error is None else f": failed. {error}"
        self.say(f"[{self._ended}/{self._count}] {named_trial(trial)}{how}{self._left(', ')}")
        self._show()

    def say(self, text: str) -> None:
        """Show a line that stays."""
        if not self._quiet:
            with suppress(OSError, ValueError):
                self._console.print(text, soft_wrap=True)

    def _show(self) -> None:
        if self._bar is not None and self._task is not None:
            self._bar.update(
                self._task,
                completed=self._remaining.share,
                description=self._where(),
                left=self._left(""),
            )

    def _where(self) -> str:
        return f"{self._ended} of {self._count} trials"

    def _left(self, before: str) -> str:
        seconds = self._remaining.seconds_left()
        return "" if seconds is None else f"{before}about {duration(seconds)} left"


def named_trial(trial: Trial) -> str:
    """Return the name of a trial."""
    return f"{trial.algorithm} on {trial.variant}, seed {trial.seed}"
