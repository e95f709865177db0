"""The display of a training on standard error: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import sys
import time
from collections import deque
from typing import Final, Self, TextIO

import numpy as np
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from serp._util.terminal import open_console, visible
from serp._util.text import duration, percent, readable, sparkline
from serp.agent.decision import Actor
from serp.runs.run_config import Budget
from serp.runs.trainer import Trainer

_MEMORY: Final = 30.0
"""Seconds over which the speed, and the share of the planner, are measured."""
_CLOSED: Final = (OSError, ValueError)
"""What a stream raises that was closed; it does not end the training."""


class Progress:
    """Shows a training while its body runs, by default on standard error.

    The figures are the progress, the return and its trend, who acts, the unsafe actions executed,
    and the time left. `quiet` shows nothing, except for answers on a terminal.
    """

    def __init__(
        self,
        trainer: Trainer,
        budget: Budget,
        title: str,
        *,
        quiet: bool = False,
        stream: TextIO | None = None,
    ) -> None:
        self._trainer, self._budget, self._title = trainer, budget, title
        self._quiet = quiet
        self._console = console = open_console(stream, stderr=True)
        self._on_terminal = console.is_terminal and not console.is_dumb_terminal
        # No refresh thread: it would draw while the loop computes. Other output to a terminal goes
        # above the bar; output to a file or a pipe is not redirected.
        self._bar = Bar(
            BarColumn(24),
            TextColumn("{task.description}", markup=False),
            console=console,
            auto_refresh=False,
            redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),
            redirect_stderr=sys.stderr is not None and sys.stderr.isatty(),
            disable=quiet or not self._on_terminal,
        )
        self._next = float("inf")  # time of the next refresh
        self._shown = trainer.env_steps
        self._returns: list[float] = []  # mean of the newest episodes at each refresh
        self._samples: deque[tuple[float, dict[str, int], int]] = deque()

    def __enter__(self) -> Self:
        if not self._quiet:
            self._sample()
            self._next = time.monotonic()
            if not self._bar.disable:
                self.note(self._title)
            with contextlib.suppress(*_CLOSED):
                self._bar.start()
                self._bar.add_task("", total=1.0)
        return self

    def __exit__(self, *exception: object) -> None:
        if not self._quiet and self._shown != self._trainer.env_steps:
            self._show()
        with contextlib.suppress(*_CLOSED):
            self._bar.stop()

    def refresh(self) -> None:
        """Show the newest figures if it is time; cheap enough for every step."""
        if time.monotonic() >= self._next:
            self._show()

    def note(self, text: str) -> None:
        """Show a permanent line, such as a warning, unless the display is quiet."""
        if not self._quiet:
            self._print(text)

    def answer(self, text: str) -> None:
        """Show a line in response to a key; even a quiet display shows it on a terminal."""
        if not self._quiet or self._on_terminal:
            self._print(text)

    def _print(self, text: str) -> None:
        with contextlib.suppress(*_CLOSED):
            self._console.print(text, soft_wrap=True)

    def _show(self) -> None:
        self._sample()
        self._shown = self._trainer.env_steps
        self._next = time.monotonic() + (10.0 if self._bar.disable else 0.2)
        if self._bar.disable:
            self._print(self._figures())
            return
        now = self._budget.counts(self._trainer)
        spent = [now[name] / limit for name, limit in self._budget.limits.items()]
        with contextlib.suppress(*_CLOSED):
            text, done = visible(self._figures()), max(spent, default=0.0)
            self._bar.update(self._bar.task_ids[0], completed=done, description=text)
            self._bar.refresh()

    def _figures(self) -> str:
        trainer, limits = self._trainer, self._budget.limits
        (begin, before, planner), (end, now, planner_now) = self._samples[0], self._samples[-1]
        names = {"episodes": "episode", "env_steps": "step"}
        figures = [
            f"{names[name]} {now[name]:,}" + (f"/{limits[name]:,}" if name in limits else "")
            for name in limits or ("env_steps",)
        ]
        if trainer.recent:
            trend = "" if self._console.options.ascii_only else sparkline(self._returns)
            figures.append(f"return {readable(float(np.mean(trainer.recent)))} {trend}".rstrip())
        if (steps := now["env_steps"] - before["env_steps"]) > 0:
            figures.append(f"planner acts {percent((planner_now - planner) / steps)}")
        figures.append(f"unsafe {trainer.tally.unsafe_executed:,}")
        left = [
            (limit - now[name]) * (end - begin) / (now[name] - before[name])
            for name, limit in limits.items()
            if limit > now[name] > before[name] and end - begin > 0.5  # else it would be noise
        ]
        return ", ".join([*figures, *(f"time left {duration(min(left))}" for _ in left[:1])])

    def _sample(self) -> None:
        trainer = self._trainer
        planner = trainer.tally.executed[Actor.PLANNER]
        self._samples.append((trainer.wall_time, self._budget.counts(trainer), planner))
        if trainer.recent:
            self._returns.append(float(np.mean(trainer.recent)))
        while len(self._samples) > 2 and self._samples[1][0] <= trainer.wall_time - _MEMORY:
            self._samples.popleft()
