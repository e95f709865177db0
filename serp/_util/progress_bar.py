"""A bar for a known number of pieces of work: on a terminal's standard error, else nothing."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

from serp._util.terminal import open_console


@contextlib.contextmanager
def bar(title: str, total: int, *, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Show how far some work is, and take the bar away at its end.

    Args:
        title: What is done.
        total: Number of pieces.
        quiet: Show nothing.

    Yields:
        A function to be called after each piece.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    name = TextColumn("{task.description}", markup=False)
    columns = (name, BarColumn(), MofNCompleteColumn(), Remaining())
    # No thread of rich's own: it would draw while the policy computes.
    shown = Progress(*columns, console=open_console(sys.stderr), auto_refresh=False, transient=True)
    task = shown.add_task(title, total=total)

    def advance() -> None:
        # The bar is not worth the work: a terminal that went away ends the bar alone.
        with contextlib.suppress(OSError, ValueError):
            shown.update(task, advance=1, refresh=True)

    with contextlib.suppress(OSError, ValueError):
        shown.start()
        shown.refresh()
    try:
        yield advance
    finally:
        with contextlib.suppress(OSError, ValueError):
            shown.stop()
