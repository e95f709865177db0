"""The display of a training on standard error: a panel on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Final, Self, TextIO

import numpy as np
from rich.columns import Columns
from rich.console import Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.text import Text

from serp._util.compilation import compile_seconds, compiled_functions, notifying_of_compilation
from serp._util.terminal import open_console, visible
from serp._util.text import duration, percent, plural, readable
from serp.runs.trainer import Budget, Trainer

_PANEL_EVERY: Final = 0.2  # seconds; a refresh takes 5 ms
_LINE_EVERY: Final = 5.0  # seconds
_MEMORY: Final = 30.0  # seconds over which the speed is measured
_TOO_SHORT: Final = 0.5  # seconds over which a measured speed would be noise


class Progress:
    """Shows a training while its body runs; a stream that was closed does not end the training.

    `quiet` shows nothing, except for answers on a terminal. The stream is standard error by
    default.
    """

    def __init__(
        self,
        trainer: Trainer,
        budget: Budget,
        title: str,
        *,
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trainer = trainer
        self._budget = budget
        self._title = title
        self._quiet = quiet
        self._clock = clock
        self._on_terminal = is_terminal(stream)
        self._console = open_console(stream, stderr=True)
        self._live: Live | None = None
        self._next = float("inf")  # time of the next refresh
        self._shown = trainer.env_steps
        self._samples: deque[tuple[float, dict[str, int]]] = deque()

    def __enter__(self) -> Self:
        if self._quiet:
            return self
        self._sample()
        self._next = self._clock()
        if self._on_terminal:
            # No refresh thread: it would draw while the loop computes. Other output to a terminal
            # goes above the panel; output to a file or a pipe is not redirected.
            self._live = Live(
                console=self._console,
                auto_refresh=False,
                redirect_stdout=is_terminal(sys.stdout),
                redirect_stderr=is_terminal(sys.stderr),
            )
            self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if not self._quiet and self._shown != self._trainer.env_steps:
            self._show()
        if self._live is not None:
            with contextlib.suppress(OSError, ValueError):
                self._live.stop()

    def refresh(self) -> None:
        """Show the newest numbers if it is time; cheap enough for every step."""
        if self._clock() >= self._next:
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
        with contextlib.suppress(OSError, ValueError):
            self._console.print(text, soft_wrap=True)

    def _show(self) -> None:
        self._sample()
        self._shown = self._trainer.env_steps
        try:
            if self._live is None:
                text = ", ".join(f"{label} {value}" for label, value in self._numbers())
                self._console.print(text, soft_wrap=True)
            else:
                self._live.update(self._panel(), refresh=True)
        except (OSError, ValueError):  # the stream was closed
            self._next = float("inf")
        else:
            self._next = self._clock() + (_LINE_EVERY if self._live is None else _PANEL_EVERY)

    def _panel(self) -> Panel:
        cells = [Text.assemble((f"{label} ", "dim"), value) for label, value in self._numbers()]
        now = self._budget.counts(self._trainer)
        spent = max((now[name] / limit for name, limit in self._budget.limits.items()), default=0.0)
        bar = ProgressBar(total=1.0, completed=spent, width=32)
        return Panel(
            Group(Columns(cells, padding=(0, 3), equal=True), bar),
            title=Text(visible(self._title)),
            title_align="left",
            expand=False,
        )

    def _numbers(self) -> list[tuple[str, str]]:
        """Return labels and values."""
        trainer, budget = self._trainer, self._budget
        numbers = [
            ("episode", _of(trainer.episode, budget.episodes)),
            ("step", _of(trainer.env_steps, budget.env_steps)),
        ]
        if budget.units is not None:
            unit = trainer.settings.arbiter.rho_unit
            numbers.insert(0, (unit, _of(trainer.units, budget.units)))
        if trainer.recent:
            numbers.append(("return", readable(trainer.recent[-1])))
            mean = readable(float(np.mean(trainer.recent)))
            numbers.append((f"mean of last {len(trainer.recent)}", mean))
        strategy = trainer.agent.strategy
        evidence = strategy.evidence
        if evidence is not None:
            leads = ("planner", evidence.planner), ("learner", evidence.learner)
            numbers += [(name, str(worth)) for name, worth in leads if worth is not None]
        numbers.append(("rho", readable(strategy.rho)))
        numbers += self._sight()
        numbers.append(("vetoes", f"{trainer.tally.vetoes:,}"))
        numbers.append(("unsafe executed", f"{trainer.tally.unsafe_executed:,}"))
        if trainer.wall_time > 0:
            numbers.append(("steps/s", f"{trainer.env_steps / trainer.wall_time:,.0f}"))
        left = self._seconds_left()
        if left is not None:
            numbers.append(("time left", duration(left)))
        return numbers

    def _sight(self) -> list[tuple[str, str]]:
        """Return how far the planner saw in the whole run, and whether its model is adapted."""
        tally, steps = self._trainer.tally, self._trainer.tally.steps
        if not steps:
            return []
        model = self._trainer.agent.adaptation.model
        shares = [("saw all", tally.saw_all), ("by cells", tally.by_cells),
                  ("cut short", tally.cut_short), ("indifferent", tally.indifferent)]  # fmt: skip
        return [
            ("model", "adapted" if model.revision else "as written"),
            *((label, percent(count / steps)) for label, count in shares),
        ]

    def _sample(self) -> None:
        now = self._trainer.wall_time
        self._samples.append((now, self._budget.counts(self._trainer)))
        while len(self._samples) > 2 and self._samples[1][0] <= now - _MEMORY:
            self._samples.popleft()

    def _seconds_left(self) -> float | None:
        """Return the estimated seconds until the first limit is reached; None if unknown."""
        (begin, before), (end, now) = self._samples[0], self._samples[-1]
        if end - begin < _TOO_SHORT:
            return None
        left = [
            max(0, limit - now[name]) * (end - begin) / (now[name] - before[name])
            for name, limit in self._budget.limits.items()
            if now[name] > before[name]
        ]
        return min(left, default=None)


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether a stream, by default standard error, can overwrite what it shows."""
    stream = stream or sys.stderr
    with contextlib.suppress(ValueError):  # it was closed
        dumb = os.environ.get("TERM", "").lower() in ("dumb", "unknown")
        return stream is not None and stream.isatty() and not dumb
    return False


def _of(now: int, limit: int | None) -> str:
    return f"{now:,}" if limit is None else f"{now:,}/{limit:,}"


@contextlib.contextmanager
def show_compiling(*, quiet: bool = False, stream: TextIO | None = None) -> Iterator[None]:
    """Show that loops are compiled in the body, and afterwards how many.

    Nothing is shown if `quiet`, or if all machine code comes from the cache. The stream is standard
    error by default.
    """
    if quiet:
        yield
        return
    console = open_console(stream, stderr=True)
    status = console.status("Compiling, once …") if is_terminal(stream) else None
    loops, seconds = compiled_functions(), compile_seconds()

    def begin() -> None:
        with contextlib.suppress(OSError, ValueError):  # the stream was closed
            if status is not None:
                status.start()
            elif compiled_functions() == loops + 1:
                console.print("Compiling, once …")

    try:
        with notifying_of_compilation(begin):
            yield
    finally:
        with contextlib.suppress(OSError, ValueError):
            if status is not None:
                status.stop()
            if compiled_functions() > loops:
                what = plural(compiled_functions() - loops, "loop")
                took = duration(compile_seconds() - seconds)
                console.print(f"Compiled {what} in {took}, kept for later runs.")
