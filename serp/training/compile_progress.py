"""The display of compilation: that it goes on, how far it is, and that it happens once."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Final, TextIO

from serp._util.compile_time import compile_seconds, compiled_functions, notifying_of_compilation
from serp._util.number_format import duration
from serp.training.progress_display import is_live

_LINE_EVERY: Final = 5.0  # seconds, where lines stay
_ERASE: Final = "\r\x1b[K"


@contextlib.contextmanager
def show_compiling(
    *,
    quiet: bool = False,
    stream: TextIO | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[None]:
    """Show what is compiled meanwhile: a line that renews itself on a terminal, else some lines.

    Nothing is shown where all machine code is kept from before.

    Args:
        quiet: Show nothing.
        stream: Where; standard error by default.
        clock: Seconds, monotonic.
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
        """Show how far it is, if it is time to."""
        now = self._clock()
        if not self._live and now < self._next:
            return
        self._next = now + _LINE_EVERY
        loops, seconds = compiled_functions() - self._loops, compile_seconds() - self._seconds
        text = f"Compiling, once: loop {loops}, {duration(seconds)} so far"
        self._write(f"{_ERASE}{text}" if self._live else f"{text}\n")

    def end(self) -> None:
        """Say what it came to, if there was anything."""
        loops, seconds = compiled_functions() - self._loops, compile_seconds() - self._seconds
        if loops:
            what = f"{loops} loop" + "s" * (loops != 1)
            text = f"Compiled {what} in {duration(seconds)}, kept for later runs.\n"
            self._write(f"{_ERASE}{text}" if self._live else text)

    def _write(self, text: str) -> None:
        # A display is not worth a run: a reader that went away ends the display alone.
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)
            self._stream.flush()
