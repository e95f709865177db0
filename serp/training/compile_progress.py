"""The display of the progress of compilation."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Final, TextIO

from serp._util.compile_time import compile_seconds, compiled_functions, notifying_of_compilation
from serp._util.number_format import duration
from serp.training.progress_display import is_live

_LINE_EVERY: Final = 5.0  # seconds between lines if they cannot be overwritten
_ERASE: Final = "\r\x1b[K"


@contextlib.contextmanager
def show_compiling(
    *,
    quiet: bool = False,
    stream: TextIO | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[None]:
    """Show the progress of compilation in the body: one updated line on a terminal, else lines.

    Nothing is shown if all machine code comes from the cache.

    Args:
        quiet: Show nothing.
        stream: The stream; standard error by default.
        clock: Monotonic clock, seconds.
    """
    stream = stream or sys.stderr
    if quiet or stream is None:
        yield
        return
    display = _Display(stream, clock)
    try:
        with notifying_of_compilation(display.update):
            yield
    finally:
        display.end()


class _Display:
    def __init__(self, stream: TextIO, clock: Callable[[], float]) -> None:
        self._stream = stream
        self._live = is_live(stream)
        self._clock = clock
        self._next = -float("inf")
        self._loops = compiled_functions()
        self._seconds = compile_seconds()

    def update(self) -> None:
        """Show the progress, if it is due."""
        now = self._clock()
        if not self._live and now < self._next:
            return
        self._next = now + _LINE_EVERY
        loops, seconds = compiled_functions() - self._loops, compile_seconds() - self._seconds
        text = f"Compiling, once: loop {loops}, {duration(seconds)} so far"
        self._write(f"{_ERASE}{text}" if self._live else f"{text}\n")

    def end(self) -> None:
        """Show the total, if anything was compiled."""
        loops, seconds = compiled_functions() - self._loops, compile_seconds() - self._seconds
        if loops:
            what = f"{loops} loop" + "s" * (loops != 1)
            text = f"Compiled {what} in {duration(seconds)}, kept for later runs.\n"
            self._write(f"{_ERASE}{text}" if self._live else text)

    def _write(self, text: str) -> None:
        # A closed stream must not end the run.
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)
            self._stream.flush()
