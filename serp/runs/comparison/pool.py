"""Running trials: here one after another, in processes of this machine, or on a cluster.

A trial writes its own run folder, so that one which is stopped or whose worker is lost goes on from
its last checkpoint.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple, Self

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from serp._util.numbers import whole
from serp._util.plugins import find, loading, offered
from serp._util.processes import follow_parent, safe_path, unsafe_path
from serp._util.terminal import open_console
from serp.errors import Interrupted, RunError, SerpError, SettingsError
from serp.runs.comparison.trial import Job, run_trial
from serp.runs.train import Stopping
from serp.settings import Section

GROUP: Final = "serp.engines"
"""Entry-point group of engines: functions of type `Engine`."""
LOCAL: Final = "local"
"""The engine of this library: processes of this machine."""

Engine = Callable[[str | None, int | None], AbstractContextManager[tuple[futures.Executor, int]]]
"""(address of a cluster, most trials at the same time) → an executor and how many trials it runs.

Without an address the engine starts workers on this machine. Without a number, as many trials run
at the same time as there are cores."""


def find_engine(name: str) -> Engine:
    """Return the engine of a name, which is not `local`; raise a SettingsError if there is none."""
    entry = find(offered(GROUP), name, "engine", SettingsError, known=[LOCAL])
    with loading(entry, "engine", SettingsError):
        engine: Engine = entry.load()
    return engine


_LOST: Final = (
    "its worker was lost. Repeat the command to continue the trial. Perhaps the memory is too "
    "small for so many trials at the same time (--jobs), or a script calls serp outside of "
    '`if __name__ == "__main__":`'
)


class TrialsRequest(Section):
    """Options of whatever runs trials: settings, seeds, and where. None stands for the default."""

    first_seed: ClassVar[int] = 0
    """Where seeds begin of which only the number is given."""
    seeds: tuple[NonNegativeInt, ...] = ()
    settings: Mapping[str, Mapping[str, Any]] = Field(default_factory=dict)
    out: Path | None = Field(default=None, strict=False)
    engine: str = LOCAL
    address: str | None = None
    jobs: PositiveInt | None = None
    quiet: bool = False

    @model_validator(mode="before")
    @classmethod
    def _given(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if value is not None}

    @field_validator("seeds", mode="before")
    @classmethod
    def _seeds(cls, value: Any) -> Any:
        count = whole(value, 1)
        if count is not None:
            return tuple(range(cls.first_seed, cls.first_seed + count))
        seeds = tuple(value) if isinstance(value, Iterable) else ()
        if not seeds:
            raise ValueError("must be a number of seeds, at least 1, or a list such as [0, 7]")
        return tuple(dict.fromkeys(seeds))

    @model_validator(mode="after")
    def _check_engine(self) -> Self:
        if self.engine != LOCAL:
            find_engine(self.engine)
        elif self.address is not None:
            raise ValueError("address needs an engine for clusters, such as engine = 'ray'")
        return self


class Ended(NamedTuple):
    """How a trial ended: complete, stopped, or with an error."""

    job: Job
    error: str | None = None
    stopped: bool = False


@contextlib.contextmanager
def progress(what: str, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show on a terminal that work goes on; yield a function that shows a line unless quiet."""
    console = open_console(sys.stderr, quiet=quiet)

    def say(text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # a terminal that was closed ends no work
            console.print(text, soft_wrap=True)

    with console.status(what) if console.is_terminal else contextlib.nullcontext():
        yield say


def run_jobs(
    jobs: Sequence[Job], request: TrialsRequest, stopping: Stopping, say: Callable[[str], None]
) -> Iterator[Ended]:
    """Run jobs until a signal; yield how each ended that was begun."""
    if not jobs:
        return
    local = request.engine == LOCAL
    most = min(request.jobs or os.cpu_count() or 1, len(jobs)) if local else request.jobs
    here = (local and most == 1) or not _portable(jobs)
    why = (
        "the task has functions that cannot be imported elsewhere (lambdas, or functions defined "
        "in a notebook or in __main__)"
    )
    if here and not local:
        raise RunError(
            f"engine {request.engine}: {why}. Put them into a module that is installed on the "
            "engine's machines, or leave out --engine."
        )
    if here and most != 1:
        say(f"The trials run one after another: {why}.")

    def stopped() -> bool:
        running = "the running episodes" if local else "the running trials"
        then = "a repeated command resumes serp's trials and restarts the others"
        answer = stopping.answer(running, then)
        if answer is not None:
            say(answer)
        return stopping.requested

    if not here:
        yield from _run_apart(jobs, request, most, stopped)
        return
    for job in jobs:
        if stopped():
            return
        yield attempt(job, stopped)


def _portable(jobs: Sequence[Job]) -> bool:
    """Return whether jobs can be sent to other processes, which import the functions in them."""
    try:
        # Another process cannot import a notebook, and would run an unguarded script again.
        return b"__main__" not in pickle.dumps(jobs)
    except Exception:  # an attribute of a custom task may raise anything
        return False


def attempt(job: Job, stopped: Callable[[], bool] | None = None) -> Ended:
    """Run a job; an error that is no `SerpError` is a bug, and keeps its traceback."""
    try:
        run_trial(job, stopped or _stop.is_set)
    except Interrupted:
        return Ended(job, stopped=True)
    except SerpError as error:
        return Ended(job, error=str(error))
    except Exception:
        return Ended(job, error=traceback.format_exc())
    return Ended(job)


def _run_apart(
    jobs: Sequence[Job], request: TrialsRequest, most: int | None, stopped: Callable[[], bool]
) -> Iterator[Ended]:
    """Run jobs in processes or on a cluster."""
    waiting, running = deque(jobs), dict[futures.Future[Ended], Job]()
    with _opened(request, most) as (executor, slots, stop):
        while True:
            if stopped():
                waiting.clear()
                stop()
            while waiting and len(running) < slots:
                try:
                    running[executor.submit(attempt, waiting[0])] = waiting[0]
                except futures.BrokenExecutor:
                    yield from (Ended(job, error=_LOST) for job in waiting)
                    waiting.clear()
                else:
                    waiting.popleft()
            if not running:
                return
            for future in futures.wait(running, 0.2, futures.FIRST_COMPLETED).done:
                job = running.pop(future)
                try:
                    ended = future.result()
                except Exception:  # of the executor: the function itself raises none
                    ended = Ended(job, error=_LOST)
                if ended.error is None and not ended.stopped and not job.complete:
                    place = f"{job.folder} is missing: all machines need the same folder for --out"
                    ended = ended._replace(error=place)
                yield ended


@contextlib.contextmanager
def _opened(
    request: TrialsRequest, most: int | None
) -> Iterator[tuple[futures.Executor, int, Callable[[], None]]]:
    """Yield executor, trials at the same time, and a function that stops them after episodes."""
    if request.engine != LOCAL:
        with find_engine(request.engine)(request.address, most) as (executor, slots):
            yield executor, slots, lambda: None
        return
    assert most is not None
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with safe_path():
        stop = context.Event()  # begins a process, too
        with futures.ProcessPoolExecutor(most, context, _begin_worker, (stop,)) as executor:
            try:
                yield executor, most, stop.set
            except BaseException:
                for process in set(multiprocessing.active_children()) - others:
                    process.kill()
                raise


_stop: Any = threading.Event()
"""The event that stops trials; in a worker process, that of the one which began it."""


def _begin_worker(stop: Any) -> None:
    global _stop
    _stop = stop
    unsafe_path()
    follow_parent()
