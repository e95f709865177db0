"""The displays of a running training: a panel on a terminal, plain lines elsewhere, or none."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING, Any, Final, Self, TextIO

from serp._util.number_format import duration
from serp._util.terminal import open_console, visible
from serp.training.budget import Budget
from serp.training.progress import Progress, ProgressStats

if TYPE_CHECKING:
    from rich.live import Live

_LIVE_EVERY: Final = 0.2  # seconds; a refresh takes 5 ms
_LINE_EVERY: Final = 5.0  # seconds
_WIDE: Final = 72  # width of a terminal that three pairs of numbers need, characters
_BAR: Final = 28  # characters


class _Quiet(Progress):
    """No display, except for the response to a key on a terminal."""

    def __init__(self, stream: TextIO | None, **about: Any) -> None:
        super().__init__(**about)
        self._stream = stream

    def answer(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):
            if self._stream is not None and self._stream.isatty():
                self._stream.write(f"\n{visible(text)}\n")
                self._stream.flush()


class _Lines(Progress):
    """Plain lines without control codes: at the beginning, every few seconds and at the end."""

    def __init__(self, stream: TextIO, **about: Any) -> None:
        super().__init__(**about)
        self._stream = stream
        self._shown: ProgressStats | None = None
        self._rho = "ρ" if _can_write(stream, "ρ") else "rho"

    def __enter__(self) -> Self:
        super().__enter__()
        self._shown = self._latest
        self._next = self._clock()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._shown is not self._latest:
            self._show()

    def note(self, text: str) -> None:
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        text = visible(text).encode(encoding, "replace").decode(encoding)
        # A closed stream must not end the run.
        try:
            self._stream.write(text + "\n")
            self._stream.flush()
        except (OSError, ValueError):
            self._next = float("inf")

    def _show(self) -> None:
        self._sample()
        self._shown = self._latest
        self._next = self._clock() + _LINE_EVERY
        self.note(", ".join(self._parts()))

    def _parts(self) -> list[str]:
        now = self._latest
        parts = [
            f"episode {_of(now.episode, self._budget.episodes)}",
            f"step {_of(now.env_steps, self._budget.env_steps)}",
        ]
        if self._budget.units is not None:
            parts.insert(0, f"{self._unit} {_of(now.units, self._budget.units)}")
        if now.last_return is not None:
            parts.append(
                f"return {_number(now.last_return)} (mean of ≤ 20: {_number(now.mean_return)})"
            )
        if now.rho is not None:
            parts.append(f"{self._rho} {now.rho:.2f}")
        parts += [f"vetoes {now.vetoes:,}", f"unsafe executed {now.unsafe_executed:,}"]
        if now.steps_per_second is not None:
            parts.append(f"{now.steps_per_second:,.0f} steps/s")
        left = self._seconds_left()
        if left is not None:
            parts.append(f"{duration(left)} left")
        return parts


class _Panel(Progress):
    """A panel that rich refreshes in place."""

    def __init__(self, stream: TextIO, title: str, **about: Any) -> None:
        super().__init__(**about)
        self._stream = stream
        self._title = title
        self._live: Live | None = None

    def __enter__(self) -> Self:
        from rich.live import Live

        super().__enter__()
        # No refresh thread: it would draw while the loop computes. Other output to a terminal goes
        # above the panel; output to a file or a pipe is not redirected.
        self._live = Live(
            console=open_console(self._stream),
            auto_refresh=False,
            redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),
            redirect_stderr=sys.stderr is not None and sys.stderr.isatty(),
        )
        self._live.start()
        self._next = self._clock()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._live is None:
            return
        self._show()
        with contextlib.suppress(OSError, ValueError):
            self._live.stop()
        self._live = None

    def note(self, text: str) -> None:
        if self._live is not None:
            with contextlib.suppress(OSError, ValueError):
                self._live.console.print(text)

    def _show(self) -> None:
        if self._live is None:
            return
        self._sample()
        try:
            self._live.update(self._draw(), refresh=True)
        except (OSError, ValueError):  # the terminal was closed; the run continues
            self._next = float("inf")
        else:
            self._next = self._clock() + _LIVE_EVERY

    def _draw(self) -> Any:
        from rich.panel import Panel
        from rich.table import Table
        from rich.text import Text

        assert self._live is not None
        pairs = 3 if self._live.console.width >= _WIDE else 1
        numbers = Table.grid(padding=(0, 2))
        for _ in range(pairs):
            numbers.add_column(justify="right", no_wrap=True)
            numbers.add_column(justify="left", no_wrap=True)
        cells = [Text(text, style) for row in self._numbers() for text, style in row]
        for first in range(0, len(cells), 2 * pairs):
            numbers.add_row(*cells[first : first + 2 * pairs])
        outer = Table.grid()
        outer.add_row(numbers)
        done = self._done()
        if done is not None:
            full = round(done * _BAR)
            outer.add_row(
                Text.assemble(
                    ("━" * full, "blue"), ("━" * (_BAR - full), "dim"), f" {100 * done:.0f} %"
                )
            )
        return Panel(outer, title=Text(visible(self._title)), title_align="left", expand=False)

    def _numbers(self) -> list[tuple[tuple[str, str], tuple[str, str]]]:
        """Return labels and values with their styles, in rows of three."""
        now = self._latest
        speed = now.steps_per_second
        left = self._seconds_left()
        safe = "bold green" if now.unsafe_executed == 0 else "bold red"
        rows = [
            ("episode", _of(now.episode, self._budget.episodes), ""),
            ("return", _number(now.last_return), ""),
            ("vetoes", f"{now.vetoes:,}", ""),
            ("step", _of(now.env_steps, self._budget.env_steps), ""),
            ("mean of ≤ 20", _number(now.mean_return), "bold"),
            ("unsafe executed", f"{now.unsafe_executed:,}", safe),
            ("steps/s", f"{speed:,.0f}" if speed is not None else "–", ""),
            ("ρ", "–" if now.rho is None else f"{now.rho:.2f}", ""),
            ("time left", "–" if left is None else duration(left), ""),
        ]
        if self._budget.units is not None:  # units replace the speed
            rows[6] = (self._unit, _of(now.units, self._budget.units), "")
        return [((label, "dim"), (value, style)) for label, value, style in rows]


def is_live(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that can overwrite a line."""
    return stream.isatty() and os.environ.get("TERM", "").lower() not in ("dumb", "unknown")


def open_progress(
    *,
    title: str = "training",
    budget: Budget | None = None,
    unit: str = "unit",
    start: ProgressStats | None = None,
    quiet: bool = False,
    stream: TextIO | None = None,
) -> Progress:
    """Return the display that suits the stream.

    Args:
        title: Title of the live panel.
        budget: The budget of the training.
        unit: Name of its unit.
        start: The numbers of a resumed run.
        quiet: Show nothing.
        stream: The stream; by default standard error, so that standard output holds only results.

    Returns:
        A panel on a terminal, plain lines on a pipe or a dumb terminal, no display if `quiet`.
    """
    stream = stream or sys.stderr
    about: dict[str, Any] = {"budget": budget, "unit": unit, "start": start}
    if quiet or stream is None:
        return _Quiet(stream, **about)
    if is_live(stream) and _can_write(stream, "ρ━╭–"):
        return _Panel(stream, title, **about)
    return _Lines(stream, **about)


def _can_write(stream: TextIO, text: str) -> bool:
    try:
        text.encode(getattr(stream, "encoding", None) or "utf-8")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _of(now: int, budget: int | None) -> str:
    return f"{now:,}" if budget is None else f"{now:,}/{budget:,}"


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.1f}"
