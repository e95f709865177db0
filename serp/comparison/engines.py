"""Engines: what runs the trials of a comparison, found by name.

An engine of another library is a function of the entry-point group `serp.engines`. It yields a
`concurrent.futures.Executor`, which most libraries for clusters have, so it takes a few lines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Final

from serp._util.plugins import find, loading, offered
from serp.comparison.workers import (
    Ended,
    Job,
    OnProgress,
    Pool,
    portable,
    run_here,
    run_in_executor,
    run_in_processes,
)
from serp.errors import RunError, SettingsError

GROUP: Final = "serp.engines"
"""Entry-point group of engines: functions of type `Engine`."""
LOCAL: Final = "local"
"""The engine of this library: processes of this machine."""

Engine = Callable[[str | None, int | None], AbstractContextManager[Pool]]
"""(address of a cluster, most trials at the same time) → the workers, while the context lasts.

Without an address the engine starts workers on this machine. Without a number, as many trials run
at the same time as there are cores."""


def run_jobs(
    jobs: Sequence[Job],
    engine: str,
    address: str | None,
    most: int,
    on_progress: OnProgress,
    stopped: Callable[[], bool],
) -> Iterator[Ended]:
    """Run jobs on an engine, and yield how each trial ended; see `serp.compare`.

    `most` is how many trials run at the same time; 0 is for the engine to say.

    Raises:
        RunError: The task cannot be sent to the workers, or the engine cannot be started.
        SettingsError: There is no such engine, or the address is not for it.
    """
    if engine == LOCAL:
        if most == 1:
            yield from run_here(jobs, on_progress, stopped)
        else:
            yield from run_in_processes(jobs, most, on_progress, stopped)
        return
    start = find_engine(engine)
    if not portable(jobs):
        raise RunError(
            f"engine {engine}: the task has functions that cannot be imported on other machines "
            "(lambdas, or functions of a notebook or of __main__). Put them into a module that is "
            "installed there, or leave --engine out."
        )
    with start(address, most or None) as pool:
        yield from run_in_executor(jobs, pool, stopped)


def find_engine(name: str) -> Engine:
    """Return the engine of a name, which is not `local`; raise a SettingsError if there is none."""
    entry = find(offered(GROUP), name, "engine", SettingsError, known=[LOCAL])
    with loading(entry, "engine", SettingsError):
        engine: Engine = entry.load()
    return engine
