"""Running trials: here one after another, in several processes, or wherever an executor runs them.

A trial is a function of its job; whoever runs it returns what was measured, and writes nothing.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future
from concurrent.futures import wait as wait_for
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any, Final, NamedTuple

from serp.comparison.algorithms import Algorithm
from serp.comparison.plan import ComparisonProtocol
from serp.comparison.trial_records import Trial
from serp.comparison.trials.trial import Measured, run_trial
from serp.errors import SerpError
from serp.settings import Settings
from serp.tasks.task import Task
from serp.training.stopping import SIGNALS

OnProgress = Callable[[Trial, int], None]
"""(trial, its env steps so far)."""
_DIED: Final = "its process died; not enough memory?"
_RETRIES: Final = 2
"""How often a trial is begun again whose worker was lost."""


def _silent(trial: Trial, env_steps: int) -> None:
    """Tell nobody: nothing comes back from an executor before a trial has ended."""


class Ended(NamedTuple):
    """How a trial ended: with what it measured, or with an error."""

    trial: Trial
    measured: Measured | None
    error: str | None = None


class Pool(NamedTuple):
    """An executor, and how many trials it runs at the same time."""

    executor: Executor
    slots: int


@dataclass(frozen=True)
class Job:
    """The specification of one trial: everything that its result depends on.

    It is sent to other machines, so its task has the domain itself, not the name of a file.
    """

    trial: Trial
    algorithm: Algorithm
    task: Task
    settings: Settings
    protocol: ComparisonProtocol

    def run(self, on_progress: OnProgress) -> Ended:
        """Run the trial, and return how it ended."""
        trial = self.trial
        try:
            measured = run_trial(
                self.algorithm, self.task, self.settings, trial.seed, self.protocol,
                partial(on_progress, trial),
            )  # fmt: skip
        except SerpError as error:
            return Ended(trial, None, "\n".join([str(error), *getattr(error, "__notes__", [])]))
        return Ended(trial, measured)


def portable(jobs: Sequence[Job]) -> bool:
    """Return whether jobs can be sent to other processes, which import the functions in them."""
    try:
        sent = pickle.dumps(jobs)
    except Exception:  # an attribute of a custom task may raise anything
        return False
    # Another process cannot import a notebook, and would run an unguarded script again.
    return b"__main__" not in sent


def run_here(
    jobs: Sequence[Job], on_progress: OnProgress, stopped: Callable[[], bool] = lambda: False
) -> Iterator[Ended]:
    """Run jobs in this process, one after another, until `stopped`; yield how each trial ended."""
    for job in jobs:
        if stopped():
            return
        yield job.run(on_progress)


def run_in_processes(
    jobs: Sequence[Job], processes: int, on_progress: OnProgress, stopped: Callable[[], bool]
) -> Iterator[Ended]:
    """Run jobs in other processes, and yield how each trial ended.

    Once `stopped`, those that run are finished and no more begin. A process that dies takes only
    its own trial with it, unlike one of `concurrent.futures.ProcessPoolExecutor`.
    """
    waiting = deque(jobs)
    idle: list[_Worker] = []
    running: dict[Any, tuple[_Worker, Job]] = {}
    """Pipe of a worker → the worker and its job."""
    try:
        while True:
            while waiting and len(running) < processes and not stopped():
                worker, job = idle.pop() if idle else _Worker(), waiting.popleft()
                worker.begin(job)
                running[worker.pipe] = worker, job
            if not running:
                return
            for pipe in wait(list(running), timeout=0.2):
                worker, job = running[pipe]
                said = worker.listen()
                if isinstance(said, int):
                    on_progress(job.trial, said)
                    continue
                del running[pipe]
                if said is None:
                    said = Ended(job.trial, None, _DIED)
                else:
                    idle.append(worker)
                yield said
    finally:  # those that still run were not asked to finish
        for worker in (*idle, *(worker for worker, _ in running.values())):
            worker.process.kill()
            worker.process.join()


def run_in_executor(
    jobs: Sequence[Job], pool: Pool, stopped: Callable[[], bool]
) -> Iterator[Ended]:
    """Run jobs in an executor, and yield how each trial ended.

    Once `stopped`, those that run are finished and no more begin. An exception of the executor
    means that the worker was lost: the trial is begun again, at most `_RETRIES` times.
    """
    waiting = deque(jobs)
    losses: Counter[Trial] = Counter()
    running: dict[Future[Ended | Exception], Job] = {}
    while True:
        while waiting and len(running) < pool.slots and not stopped():
            job = waiting.popleft()
            running[pool.executor.submit(_attempt, job)] = job
        if not running:
            return
        for future in wait_for(running, timeout=0.2, return_when=FIRST_COMPLETED).done:
            job = running.pop(future)
            try:
                said = future.result()
            except Exception as error:
                losses[job.trial] += 1
                if losses[job.trial] <= _RETRIES:
                    waiting.append(job)
                    continue
                said = Ended(job.trial, None, f"its worker was lost {losses[job.trial]} times, the "
                             f"last time by {type(error).__name__}: {error}")  # fmt: skip
            if isinstance(said, Exception):
                raise said
            yield said


def _attempt(job: Job, on_progress: OnProgress = _silent) -> Ended | Exception:
    """Run a job in a worker; any error but a `SerpError` is a bug: it keeps its traceback."""
    try:
        return job.run(on_progress)
    except Exception as error:
        error.add_note(traceback.format_exc())
        return error


class _Worker:
    """A process that runs the jobs which are sent through its pipe, and the pipe."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other,))
        self.process.start()
        other.close()

    def begin(self, job: Job) -> None:
        """Send a job."""
        with contextlib.suppress(OSError):  # it is dead, which `listen` tells
            self.pipe.send(job)

    def listen(self) -> int | Ended | None:
        """Return the env steps of its trial so far, or how that ended; None if it is dead."""
        try:
            said: int | Ended | Exception = self.pipe.recv()
        except (EOFError, OSError):
            return None
        if isinstance(said, Exception):
            raise said
        return said


def _work(pipe: Connection) -> None:
    """Run jobs and tell of them, in another process.

    Ctrl-C, a closed terminal and a scheduler signal every process of the group; the parent decides.
    """
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        job: Job = pipe.recv()
        pipe.send(_attempt(job, lambda trial, env_steps: pipe.send(env_steps)))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
