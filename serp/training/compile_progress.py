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
