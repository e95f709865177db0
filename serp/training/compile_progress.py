"""The display of the progress of compilation."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TextIO

from serp._util.compile_time import compile_seconds, compiled_functions, notifying_of_compilation
from serp._util.number_format import duration
from serp._util.terminal import open_console
from serp._util.text import plural
from serp.training.progress import is_terminal


@contextlib.contextmanager
def show_compiling(*, quiet: bool = False, stream: TextIO | None = None) -> Iterator[None]:
    """Show on standard error that loops are compiled in the body, and afterwards how many.

    A terminal counts them. Nothing is shown if all machine code comes from the cache.

    Args:
        quiet: Show nothing.
        stream: The stream; by default standard error.
    """
    if quiet:
        yield
        return
    console = open_console(stream, stderr=True)
    status = console.status("") if is_terminal(stream) else None
    loops_before, seconds_before = compiled_functions(), compile_seconds()

    def compiled() -> tuple[int, str]:
        return compiled_functions() - loops_before, duration(compile_seconds() - seconds_before)

    def show() -> None:
        loops, seconds = compiled()
        with contextlib.suppress(OSError, ValueError):  # the stream was closed
            if status is not None:
                status.update(f"Compiling, once: loop {loops}, {seconds} so far")
                status.start()
            elif loops == 1:
                console.print("Compiling, once …")

    try:
        with notifying_of_compilation(show):
            yield
    finally:
        loops, seconds = compiled()
        with contextlib.suppress(OSError, ValueError):
            if status is not None:
                status.stop()
            if loops:
                console.print(
                    f"Compiled {plural(loops, 'loop')} in {seconds}, kept for later runs."
                )
