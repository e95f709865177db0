"""Running trials: here one after another, in several processes, or wherever an executor runs them.

A trial is a function of its job; whoever runs it returns what was measured, and writes nothing.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, ClassVar, Final, NamedTuple, Self

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator
from rich.progress import BarColumn, Progress, TextColumn

from serp._util.numbers import whole
from serp._util.plugins import find, loading, offered
from serp._util.processes import follow_parent, safe_path, unsafe_path
from serp._util.terminal import open_console
from serp._util.text import duration
from serp.errors import RunError, SerpError, SettingsError, with_notes
from serp.runs.comparison.algorithms import Algorithm
from serp.runs.comparison.plan import ComparisonProtocol, SettingChanges, Trial
from serp.runs.comparison.trial import Measured, run_trial
from serp.settings import Section, Settings
from serp.tasks.task import Task


class Display:
    """Shows the progress of a comparison on standard error."""

    def __init__(self, trials: Iterable[Trial], env_steps: int, *, quiet: bool) -> None:
        self._env_steps = env_steps
        self._done = dict.fromkeys(trials, 0)
        self._steps = 0  # of all trials; a sum over 100,000 of them takes too long
        self._ended = 0
        self._quiet = quiet
        self._begin = time.monotonic()
        console = open_console(sys.stderr)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
        )
        self._bar = Progress(
            *columns, console=console, transient=True, disable=quiet or not console.is_terminal
        )
        self._task = self._bar.add_task("", total=max(1, env_steps * len(self._done)))

    def __enter__(self) -> Self:
        self._show()
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(OSError, ValueError):
            self._bar.stop()

    def notice(self, trial: Trial, env_steps: int) -> None:
        """Show the env steps of a trial so far."""
        self._steps += env_steps - self._done[trial]
        self._done[trial] = env_steps
        self._show()

    def end(self, trial: Trial, error: str | None) -> None:
        """Show that a trial has ended."""
        self._ended += 1
        self.notice(trial, self._env_steps)
        how = "" if error is None else f": failed. {error}"
        self.say(f"[{self._ended}/{len(self._done)}] {trial}{how}{self._left()}")

    def say(self, text: str) -> None:
        """Show a line that stays."""
        if not self._quiet:
            with suppress(OSError, ValueError):
                self._bar.console.print(text, soft_wrap=True)

    def _show(self) -> None:
        where = f"{self._ended} of {len(self._done)} trials{self._left()}"
        self._bar.update(self._task, completed=self._steps, description=where)

    def _left(self) -> str:
        """Return the remaining time, if env steps of all trials take equally long."""
        left = self._env_steps * len(self._done) - self._steps
        if not self._steps or not left:
            return ""
        return f", about {duration((time.monotonic() - self._begin) * left / self._steps)} left"


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


GROUP: Final = "serp.engines"
"""Entry-point group of engines: functions of type `Engine`."""
LOCAL: Final = "local"
"""The engine of this library: processes of this machine."""

ONE_AFTER_ANOTHER: Final = (
    "The trials run one after another: the task has functions that cannot be imported from other "
    "processes (lambdas, or functions of a notebook or of __main__)."
)
"""What is said where jobs run in this process though several might run at the same time."""

Engine = Callable[[str | None, int | None], AbstractContextManager[Pool]]
"""(address of a cluster, most trials at the same time) → the workers, while the context lasts.

Without an address the engine starts workers on this machine. Without a number, as many trials run
at the same time as there are cores."""


@contextmanager
def open_pool(engine: str, address: str | None, most: int) -> Iterator[Pool]:
    """Yield the workers of an engine; see `serp.compare`.

    `most` is how many trials run at the same time, see `at_once`.

    Raises:
        RunError: The engine cannot be started.
        SettingsError: There is no such engine.
    """
    if engine != LOCAL:
        with find_engine(engine)(address, most or None) as pool:
            yield pool
        return
    with Processes(most) as processes:
        yield Pool(processes, most, processes.told)


def at_once(engine: str, asked: int | None, jobs: int) -> int:
    """Return how many of so many jobs run at the same time; 0 is for the engine to say."""
    return min(asked or os.cpu_count() or 1, jobs) if engine == LOCAL else asked or 0


def runs_here(engine: str, jobs: Sequence[Job], most: int) -> bool:
    """Return whether jobs run in this process.

    Those do of which one runs at a time: another process would only have to import and to load
    compiled code once more. So do those that cannot be sent to other processes.

    Args:
        engine: The engine.
        jobs: The jobs.
        most: What `at_once` returns.

    Raises:
        RunError: They cannot be sent to the workers, and the engine is not `local`.
    """
    if engine == LOCAL and most == 1:
        return True
    if portable(jobs):
        return False
    if engine != LOCAL:
        raise RunError(
            f"engine {engine}: the task has functions that cannot be imported on other machines "
            "(lambdas, or functions of a notebook or of __main__). Put them into a module that is "
            "installed there, or leave --engine out."
        )
    return True


def find_engine(name: str) -> Engine:
    """Return the engine of a name, which is not `local`; raise a SettingsError if there is none."""
    entry = find(offered(GROUP), name, "engine", SettingsError, known=[LOCAL])
    with loading(entry, "engine", SettingsError):
        engine: Engine = entry.load()
    return engine


class TrialsRequest(Section):
    """Options of whatever runs trials: their settings and seeds, and where they run.

    None stands for the default. An engine that cannot be found is refused, too.
    """

    first_seed: ClassVar[int] = 0
    """Where seeds begin of which only the number is given."""
    seeds: tuple[NonNegativeInt, ...] = ()
    settings: SettingChanges = Field(default_factory=dict)
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
            raise ValueError("must be how many, at least 1, or a list such as [0, 7]")
        return tuple(dict.fromkeys(seeds))

    @model_validator(mode="after")
    def _found(self) -> Self:
        if self.engine != LOCAL:
            find_engine(self.engine)
        elif self.address is not None:
            raise ValueError("address is for an engine of a cluster, such as engine = 'ray'")
        return self
