"""The display of a running comparison: a bar on a terminal, one line per trial elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Self

from rich.progress import BarColumn, Progress, TextColumn

from serp._util.number_format import duration
from serp._util.terminal import open_console
from serp.comparison.trial_records import Trial


class Display:
    """Shows the progress of a comparison on standard error."""

    def __init__(self, trials: Iterable[Trial], env_steps: int, *, quiet: bool) -> None:
        self._env_steps = env_steps
        self._done = dict.fromkeys(trials, 0)
        self._steps = 0  # of all trials; a sum over 100,000 of them takes too long
        self._ended = 0
        self._quiet = quiet
        self._begin = time.monotonic()
        console = open_console(sys.stderr)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
        )
        self._bar = Progress(
            *columns, console=console, transient=True, disable=quiet or not console.is_terminal
        )
        self._task = self._bar.add_task("", total=max(1, env_steps * len(self._done)))

    def __enter__(self) -> Self:
        self._show()
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(OSError, ValueError):
            self._bar.stop()

    def notice(self, trial: Trial, env_steps: int) -> None:
        """Show the env steps of a trial so far."""
        self._steps += env_steps - self._done[trial]
        self._done[trial] = env_steps
        self._show()

    def end(self, trial: Trial, error: str | None) -> None:
        """Show that a trial has ended."""
        self._ended += 1
        self.notice(trial, self._env_steps)
        how = "" if error is None else f": failed. {error}"
        self.say(f"[{self._ended}/{len(self._done)}] {trial}{how}{self._left()}")

    def say(self, text: str) -> None:
        """Show a line that stays."""
        if not self._quiet:
            with suppress(OSError, ValueError):
                self._bar.console.print(text, soft_wrap=True)

    def _show(self) -> None:
        where = f"{self._ended} of {len(self._done)} trials{self._left()}"
        self._bar.update(self._task, completed=self._steps, description=where)

    def _left(self) -> str:
        """Return the remaining time, if env steps of all trials take equally long."""
        left = self._env_steps * len(self._done) - self._steps
        if not self._steps or not left:
            return ""
        return f", about {duration((time.monotonic() - self._begin) * left / self._steps)} left"
