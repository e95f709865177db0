"""Running trials: here one after another, in several processes, or wherever an executor runs them.

A trial is a function of its job; whoever runs it returns what was measured, and writes nothing.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import pickle
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Final, NamedTuple

from serp._util.processes import follow_parent, safe_path, unsafe_path
from serp.comparison.algorithms import Algorithm
from serp.comparison.plan import ComparisonProtocol
from serp.comparison.trial_records import Trial
from serp.comparison.trials.trial import Measured, run_trial
from serp.errors import RunError, SerpError, with_notes
from serp.settings import Settings
from serp.tasks.task import Task

OnProgress = Callable[[Trial, int], None]
"""(trial, its env steps so far)."""
_DIED: Final = "the process died; not enough memory?"
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
    """An executor, and how many trials it runs at the same time.

    `told` has trials with their env steps so far, if the executor tells them.
    """

    executor: Executor
    slots: int
    told: SimpleQueue[tuple[Trial, int]] | None = None


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
            return Ended(trial, None, with_notes(error))
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


def run_in_executor(
    jobs: Sequence[Job], pool: Pool, on_progress: OnProgress, stopped: Callable[[], bool]
) -> Iterator[Ended]:
    """Run jobs in an executor, and yield how each trial ended.

    Once `stopped`, those that run are finished and no more begin. An exception of the executor
    means that the worker was lost: the trial is begun again, at most `_RETRIES` times.

    Raises:
        RunError: The executor takes no more jobs.
    """
    waiting = deque(jobs)
    losses: Counter[Trial] = Counter()
    running: dict[Future[Ended | Exception], Job] = {}
    try:
        while True:
            while waiting and len(running) < pool.slots and not stopped():
                job = waiting.popleft()
                try:
                    running[pool.executor.submit(_attempt, job)] = job
                except Exception as error:
                    raise RunError(
                        f"the engine takes no more trials ({type(error).__name__}: {error}). What "
                        "is complete is kept: give the same command again"
                    ) from error
            if not running:
                return
            done = wait_for(running, timeout=0.2, return_when=FIRST_COMPLETED).done
            while pool.told is not None and not pool.told.empty():
                on_progress(*pool.told.get())
            for future in done:
                said = _result(future, job := running.pop(future), losses)
                if said is None:
                    waiting.append(job)
                else:
                    yield said
    finally:
        for future in running:
            future.cancel()


def _result(future: Future[Ended | Exception], job: Job, losses: Counter[Trial]) -> Ended | None:
    """Return how a trial ended; None if its worker was lost and it is to begin again."""
    try:
        said = future.result()
    except Exception as error:
        losses[job.trial] += 1
        if losses[job.trial] <= _RETRIES:
            return None
        return Ended(job.trial, None, "its worker was lost, in each of "
                     f"{_RETRIES + 1} attempts: {type(error).__name__}: {error}")  # fmt: skip
    if isinstance(said, Exception):
        raise said
    return said


def _attempt(job: Job, on_progress: OnProgress = _silent) -> Ended | Exception:
    """Run a job in a worker; any error but a `SerpError` is a bug: it keeps its traceback."""
    unsafe_path()
    try:
        return job.run(on_progress)
    except Exception as error:
        error.add_note(traceback.format_exc())
        return error


class Processes(Executor):
    """Processes of this machine, each of which runs one job at a time and tells of it.

    A process that dies takes only its own trial with it, unlike one of
    `concurrent.futures.ProcessPoolExecutor`. Those that still run at the end are killed.

    Attributes:
        told: Trials with their env steps so far.
    """

    def __init__(self, most: int) -> None:
        self.told: SimpleQueue[tuple[Trial, int]] = SimpleQueue()
        self._threads = ThreadPoolExecutor(most)  # each waits for one process
        self._lock = threading.Lock()
        self._idle: list[_Worker] = []
        self._workers: list[_Worker] | None = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call `function(job, on_progress)` in a process; `args` holds the job."""
        return self._threads.submit(self._run, function, *args)

    def _run(self, function: Callable[..., Any], job: Job) -> Any:
        worker = self._worker()
        worker.begin(function, job)
        while isinstance(said := worker.listen(), int):
            self.told.put((job.trial, said))
        if said is None:
            raise ConnectionError(_DIED)
        self._idle.append(worker)
        return said

    def _worker(self) -> _Worker:
        with self._lock:
            if self._workers is None:
                raise ConnectionError("the executor is shut down")
            if self._idle:
                return self._idle.pop()
            self._workers.append(_Worker())
            return self._workers[-1]

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill all processes, whatever they do."""
        with self._lock:
            workers, self._workers = self._workers or [], None
        for worker in workers:
            worker.process.kill()
            worker.process.join()
        self._threads.shutdown(cancel_futures=True)


class _Worker:
    """A process that runs the jobs which are sent through its pipe, and the pipe."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other,))
        with safe_path():
            self.process.start()
        other.close()

    def begin(self, function: Callable[..., Any], job: Job) -> None:
        """Send a job."""
        with contextlib.suppress(OSError):  # it is dead, which `listen` tells
            self.pipe.send((function, job))

    def listen(self) -> int | Ended | Exception | None:
        """Return the env steps of its trial so far, or how that ended; None if it is dead."""
        try:
            said: int | Ended | Exception = self.pipe.recv()
        except (EOFError, OSError):
            return None
        return said


def _work(pipe: Connection) -> None:
    """Run jobs and tell of them, in another process."""
    follow_parent()
    while True:
        function, job = pipe.recv()
        pipe.send(function(job, lambda trial, env_steps: pipe.send(env_steps)))
