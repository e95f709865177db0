"""Running trials, one after another or in several processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import Any

from serp.comparison.algorithms import Algorithm, Changes
from serp.comparison.protocol import ComparisonProtocol
from serp.comparison.trial_files import is_complete, write_trial
from serp.comparison.trial_records import Trial
from serp.comparison.trials.trial import run_trial
from serp.errors import SerpError
from serp.tasks.task import Task
from serp.training.stopping import SIGNALS

OnProgress = Callable[[Trial, int], None]


@dataclass(frozen=True)
class Job:
    """Everything that a worker needs to run and write one trial.

    Attributes:
        folder: The folder of the comparison.
        trial: The trial.
        algorithm: Its algorithm.
        task: The task with the domain file of the variant.
        protocol: Budget and evaluations.
        changes: Changes to the settings of all algorithms.
        metadata: Entries of `trial.json` besides the results.
    """

    folder: Path
    trial: Trial
    algorithm: Algorithm
    task: Task
    protocol: ComparisonProtocol
    changes: Changes
    metadata: Mapping[str, Any]

    def run(self, on_progress: OnProgress) -> Ended:
        """Run the trial, write its results, and return how it ended."""
        trial = self.trial
        try:
            measured = run_trial(
                trial, self.algorithm, self.task, self.protocol, self.changes,
                partial(on_progress, trial),
            )  # fmt: skip
            metadata = {
                **self.metadata,
                "characteristics": measured.characteristics,
                "seconds": measured.seconds,
            }
            write_trial(self.folder, trial, measured, metadata, self.task.counters)
        except SerpError as error:
            notes: list[str] = getattr(error, "__notes__", [])
            return Ended(trial, "\n".join([str(error), *notes]))
        return Ended(trial, None)


@dataclass(frozen=True)
class Ended:
    """How a trial ended.

    Attributes:
        trial: The trial.
        error: The error message; None if the trial is complete.
    """

    trial: Trial
    error: str | None


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
    """Run jobs in this process, one after another, and yield how each trial ended.

    Args:
        jobs: The jobs.
        on_progress: Called with a trial and its env steps so far.
        stopped: Whether to begin no more jobs; the running one is finished.
    """
    for job in jobs:
        if stopped():
            return
        yield job.run(on_progress)


def run_in_processes(
    jobs: Sequence[Job],
    processes: int,
    on_progress: OnProgress,
    stopped: Callable[[], bool],
) -> Iterator[Ended]:
    """Run jobs in other processes, and yield how each trial ended.

    Args:
        jobs: The jobs.
        processes: Number of processes.
        on_progress: Called with a trial and its env steps so far.
        stopped: Whether to begin no more jobs; running ones are finished.
    """
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    said: Any = context.Queue()

    def begin() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            1, mp_context=context, initializer=_begin_worker, initargs=(stop, said)
        )

    # One pool per process: if a process dies, its pool and all jobs in it are lost.
    idle = [begin() for _ in range(processes)]
    running: dict[Future[Ended], tuple[Job, ProcessPoolExecutor]] = {}
    waiting = deque(jobs)
    over: set[Trial] = set()  # the queue may be late

    try:
        while True:
            while idle and waiting and not stopped():
                pool = idle.pop()
                job = waiting.popleft()
                running[pool.submit(_work, job)] = job, pool
            if not running:
                return
            done, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
            while not said.empty():
                trial, env_steps = said.get()
                if trial not in over:
                    on_progress(trial, env_steps)
            for future in done:
                job, pool = running.pop(future)
                over.add(job.trial)
                if isinstance(future.exception(), BrokenProcessPool):
                    pool.shutdown(wait=False)
                    idle.append(begin())
                    complete = is_complete(job.folder, job.trial)
                    yield Ended(job.trial, None if complete else _DIED)
                else:
                    idle.append(pool)
                    yield future.result()
    except KeyboardInterrupt:
        stop.set()
        raise
    finally:
        for pool in (*idle, *(pool for _, pool in running.values())):
            pool.shutdown(wait=not stop.is_set(), cancel_futures=True)


_DIED = "its process died; not enough memory?"


_said: Any = None


def _begin_worker(stop: Any, said: Any) -> None:
    """Ignore signals, and exit with the parent or at its request.

    Ctrl-C, a closed terminal and a scheduler signal every process of the group; the parent decides.
    """
    global _said
    _said = said
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    threading.Thread(target=_end_when, args=(stop,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _end_when(stop: Any) -> None:
    stop.wait()
    os._exit(1)


def _work(job: Job) -> Ended:
    return job.run(lambda trial, steps: _said.put((trial, steps)))
