"""`tune`: searches settings with Optuna, by the returns of whole trainings.

A trial of the study trains with several seeds; its value is the mean over them. The search is
Optuna's tree-structured Parzen estimator (Bergstra et al. 2011).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

import numpy as np
from pydantic import NonNegativeInt, PositiveInt, field_validator

from serp._util.terminal import open_console
from serp._util.text import readable
from serp.errors import Interrupted, RunError, SerpError, SettingsError, TaskError, needs_extra
from serp.runs.comparison.algorithms import SERP, find_algorithm
from serp.runs.comparison.folder import texts_of
from serp.runs.comparison.measures import measure
from serp.runs.comparison.plan import (
    EPISODE_COLUMNS,
    EVALUATION_COLUMNS,
    ComparisonProtocol,
    Record,
    Trial,
)
from serp.runs.comparison.trial import Measured
from serp.runs.comparison.trial_files import digest
from serp.runs.comparison.workers import (
    ONE_AFTER_ANOTHER,
    Job,
    Pool,
    TrialsRequest,
    at_once,
    open_pool,
    run_here,
    run_in_executor,
    runs_here,
)
from serp.runs.folder import default_path
from serp.runs.train import stop_between_episodes
from serp.runs.tuning_space import Dimension, changes_of, dimensions
from serp.settings import Changes
from serp.tasks.registry import find_task
from serp.tasks.task import Task

FIRST_SEED: Final = 1_000
"""Seeds from here on are for tuning, those from 0 on for the results that are reported."""

Objective = Literal["training", "evaluation"]


class TuningRequest(TrialsRequest):
    """The options of `serp.tune`, which describes them; None stands for the default."""

    first_seed: ClassVar[int] = FIRST_SEED
    seeds: tuple[NonNegativeInt, ...] = tuple(range(FIRST_SEED, FIRST_SEED + 3))
    vary: Mapping[str, Any]
    algorithm: str = SERP
    objective: Objective = "training"
    trials: PositiveInt = 50
    env_steps: PositiveInt | None = None
    storage: str | None = None
    study: str | None = None
    prune: bool = False
    seed: NonNegativeInt = 0

    @classmethod
    def section(cls) -> str:
        """Return the first part of the names in messages."""
        return "tune"

    @field_validator("vary", mode="before")
    @classmethod
    def _varied(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise ValueError("must be a mapping, such as {'planner.depth': '2..7'}")
        return value

    @field_validator("storage", mode="before")
    @classmethod
    def _storage(cls, value: Any) -> str:
        if not isinstance(value, str | os.PathLike) or "\0" in str(value):
            raise ValueError("must be a file, or the URL of a database")
        return str(value) if "://" in str(value) else f"sqlite:///{Path(value)}"


_FINAL = {"guided": "final_vetoed", "baseline": "final_learner", "planner": "planner"}
"""Kind of an algorithm → the measure of its trained policy."""


class Search:
    """Trains with settings, and returns what they are worth.

    Attributes:
        name: Name of the task.
        request: The options.
        space: What is varied.
        digest: Digest of everything that the values of a study depend on.
    """

    def __init__(self, task: Task, request: TuningRequest) -> None:
        self.request, self.space = request, dimensions(request.vary)
        self._algorithm = algorithm = find_algorithm(request.algorithm)
        if algorithm.kind == "external":
            raise SettingsError(f"`{algorithm.name}` has no settings that serp could tune")
        with task.bind() as bound:  # checks the task
            self.name = bound.name
            self._task = bound.task
        self._settings = algorithm.settings(task, request.settings)
        steps = request.env_steps or self._settings.training.env_steps
        evaluated = request.objective == "evaluation"
        self._protocol = ComparisonProtocol(
            env_steps=steps, evaluate_every=steps, final_episodes=50 if evaluated else 1
        )
        self._measure = _FINAL[algorithm.kind] if evaluated else "training_area"
        parts: dict[str, Any] = {
            "task": self.name,
            "texts": texts_of(self._task),
            "settings": self._settings.as_dict(),
            "protocol": self._protocol.model_dump(),
            "measure": self._measure,
            "seeds": list(request.seeds),
            "space": [repr(dimension) for dimension in self.space],
            "search": [algorithm.kind, request.seed, request.prune],
        }
        self.digest = digest(parts)

    def own_parameters(self) -> dict[str, Any]:
        """Return the settings as they are, in Optuna's form; empty if one is not in the space."""
        settings = self._settings
        found = {
            dimension.name: dimension.parameter(
                getattr(getattr(settings, dimension.section), dimension.setting)
            )
            for dimension in self.space
        }
        return {} if None in found.values() else found

    def jobs(self, varied: Changes) -> list[Job]:
        """Return the trainings with some settings, one for each seed.

        Raises:
            SettingsError: The settings contradict one another.
        """
        algorithm = self._algorithm.changed(self._algorithm.name, varied)
        settings = algorithm.settings(self._task, self.request.settings)
        return [
            Job(
                Trial(algorithm.name, self.name, s), algorithm, self._task, settings, self._protocol
            )
            for s in self.request.seeds
        ]

    def returns(
        self, varied: Changes, pool: Pool | None, stopped: Callable[[], bool]
    ) -> Generator[float, None, None]:
        """Train, and yield what each seed is worth, in the order of the seeds, until `stopped`.

        Without a pool the trainings run in this process.

        Raises:
            SettingsError: The settings contradict one another.
            RunError: A training failed.
        """

        def on_progress(trial: Trial, env_steps: int) -> None:
            stopped()

        jobs = self.jobs(varied)
        ends = (
            run_here(jobs, on_progress, stopped)
            if pool is None
            else run_in_executor(jobs, pool, on_progress, stopped)
        )
        found: dict[int, float] = {}
        waiting = iter(self.request.seeds)
        seed = next(waiting, None)
        for ended in ends:
            if ended.measured is None:
                raise RunError(f"seed {ended.trial.seed}: {ended.error}")
            found[ended.trial.seed] = self._value(ended.trial, ended.measured)
            while seed in found:
                yield found[seed]
                seed = next(waiting, None)

    def _value(self, trial: Trial, measured: Measured) -> float:
        names = [*EPISODE_COLUMNS, *(f"info.{name}" for name in measured.log.counters)]
        episodes = _columns(names, [(*row, *counts) for row, counts in measured.log.rows])
        evaluations = _columns(EVALUATION_COLUMNS, measured.evaluations)
        record = Record(trial, episodes, evaluations, {"seconds": measured.seconds})
        value = measure(record, self._protocol.env_steps, None)[self._measure]
        if not np.isfinite(value):
            raise RunError(
                f"seed {trial.seed}: no episode ended within {self._protocol.env_steps} env steps, "
                "so nothing was measured; give a larger --env-steps"
            )
        return value


def _columns(names: Any, rows: Any) -> dict[str, Any]:
    return {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}


_ASKED: Final = "serp"
_FAILED: Final = "error"
_OWN: Final = "as they were"
_PROCESS: Final = "process"
"""Names of Optuna's attributes: the digest of what a study is for; why a trial failed, whether it
has the settings as they were, and the host and the process that run it."""
_STARTUP: Final = 5
"""Trials before any is pruned."""


def open_study(optuna: Any, storage: str, name: str, asked: str) -> Any:
    """Return the study of a name, new or continued.

    Args:
        optuna: The library.
        storage: URL of the storage.
        name: Name of the study.
        asked: Digest of what the study is for.

    Raises:
        RunError: The storage cannot be used, or the study is for something else.
    """
    try:
        if storage.startswith("sqlite:///"):
            Path(storage.removeprefix("sqlite:///")).parent.mkdir(parents=True, exist_ok=True)
        study = optuna.create_study(
            study_name=name, storage=storage, direction="maximize", load_if_exists=True,
            pruner=optuna.pruners.MedianPruner(n_startup_trials=_STARTUP),
        )  # fmt: skip
        if not study.user_attrs and not study.trials:
            study.set_user_attr(_ASKED, asked)
    except Exception as error:  # every database has its own ones
        raise RunError(f"the storage {storage} cannot be used: {error}") from error
    if study.user_attrs.get(_ASKED) != asked:
        raise RunError(
            f"{storage} holds a study `{name}` of another task, or with other settings, values, "
            "seeds or budget. Give another --study or --storage."
        )
    return study


class Study:
    """Runs the trials of a study.

    Args:
        optuna: The library.
        study: The study.
        search: What its trials are.
        pool: The workers of the trainings; None for this process.
        stopped: Whether the user wants to stop.
    """

    def __init__(
        self,
        optuna: Any,
        study: Any,
        search: Search,
        pool: Pool | None,
        stopped: Callable[[], bool],
    ) -> None:
        self._optuna, self._study, self._search = optuna, study, search
        self._pool, self._stopped = pool, stopped
        self._state = optuna.trial.TrialState

    @property
    def finished(self) -> int:
        """Number of trials that came to an end; those that were interrupted did not."""
        return sum(map(self._ended, self._trials()))

    def _ended(self, trial: Any) -> bool:
        ends = (self._state.COMPLETE, self._state.PRUNED)
        return trial.state in ends or _FAILED in trial.user_attrs

    def _under_way(self, trial: Any) -> bool:
        """Return whether a trial may still come to an end: not if its process was killed."""
        running = trial.state == self._state.RUNNING and not _is_dead(trial.user_attrs)
        return running or trial.state == self._state.WAITING

    def run_trial(self) -> str | None:
        """Run the next trial; return what came of it, None if it was interrupted."""
        trial, values = self._next()
        shown = ", ".join(f"{dimension.name}={value}" for dimension, value in values.items())
        means: list[float] = []
        returns: list[float] = []
        pruned = False
        try:
            with closing(
                self._search.returns(changes_of(values), self._pool, self._stopped)
            ) as found:
                for value in found:
                    returns.append(value)
                    means.append(float(np.mean(returns)))
                    trial.report(means[-1], len(means))
                    last = len(means) == len(self._search.request.seeds)
                    pruned = self._search.request.prune and not last and trial.should_prune()
                    if pruned:
                        break
        except BaseException as error:
            if not isinstance(error, SerpError):
                self._study.tell(trial, state=self._state.FAIL)
                raise
            trial.set_user_attr(_FAILED, str(error))
            self._study.tell(trial, state=self._state.FAIL)
            return f"{shown}: failed. {error}"
        if pruned:
            self._study.tell(trial, state=self._state.PRUNED)
            return f"{shown}: {readable(means[-1])} after {len(means)} seeds, not continued"
        if len(means) < len(self._search.request.seeds):
            self._study.tell(trial, state=self._state.FAIL)
            return None
        self._study.tell(trial, means[-1])
        return f"{shown}: {readable(means[-1])}"

    def best(self) -> tuple[dict[Dimension, Any], float] | None:
        """Return the best settings and their value; None if no trial is complete."""
        complete = [t for t in self._trials() if t.state == self._state.COMPLETE]
        if not complete:
            return None
        best = max(complete, key=lambda trial: trial.value)
        return self._values(self._optuna.trial.FixedTrial(best.params)), float(best.value)

    def before(self) -> float | None:
        """Return the value of the settings as they were; None if it is not known."""
        own = self._search.own_parameters()
        values = [
            t.value for t in self._trials() if t.state == self._state.COMPLETE and t.params == own
        ]
        return float(values[0]) if values else None

    def first_failure(self) -> str:
        """Return why the first trial failed that did."""
        return next((t.user_attrs[_FAILED] for t in self._trials() if _FAILED in t.user_attrs), "")

    def _trials(self) -> list[Any]:
        trials: list[Any] = self._study.get_trials(deepcopy=False)
        return trials

    def _next(self) -> tuple[Any, Mapping[Dimension, Any]]:
        """Return a new trial of Optuna, and the settings that it suggests."""
        counted = [t for t in self._trials() if self._ended(t) or self._under_way(t)]
        own = self._search.own_parameters()
        if own and not any(_OWN in t.user_attrs or t.params == own for t in counted):
            self._study.enqueue_trial(own, user_attrs={_OWN: True})
        trial = self._study.ask()
        trial.set_user_attr(_PROCESS, [socket.gethostname(), os.getpid()])
        # The search draws anew for every trial, by the number of those that have ended: a study
        # that was interrupted goes on as it would have. Trials that run beside it count, too.
        before = [
            t for t in self._trials()
            if self._ended(t) or (t.number < trial.number and self._under_way(t))
        ]  # fmt: skip
        seed = self._search.request.seed + len(before)
        self._study.sampler = self._optuna.samplers.TPESampler(seed=seed)
        return trial, self._values(trial)

    def _values(self, trial: Any) -> dict[Dimension, Any]:
        return {dimension: dimension.suggest(trial) for dimension in self._search.space}


def _is_dead(attributes: Mapping[str, Any]) -> bool:
    """Return whether the process of a trial is known to have died; those of other hosts are not."""
    host, process = attributes.get(_PROCESS, (None, 0))
    if host != socket.gethostname() or os.name != "posix":
        return False
    try:
        os.kill(process, 0)  # sends nothing
    except ProcessLookupError:
        return True
    except PermissionError:
        pass
    return False


@dataclass(frozen=True)
class Tuned:
    """The result of a study.

    Attributes:
        settings: The best settings that were found: section → setting → value.
        value: Their objective, the mean over the seeds.
        before: The objective of the settings as they were; None if these are outside of the space.
        trials: Number of trials that came to an end.
        study: The study, an `optuna.Study`.
        storage: URL of its storage.
    """

    settings: Changes
    value: float
    before: float | None
    trials: int
    study: Any
    storage: str


def tune(task: Task | str, **options: Any) -> Tuned:
    """Search settings on a task; needs the extra `tune`.

    The first trial has the settings as they are. A call with the same storage goes on until the
    study has `trials` in all; several processes may work on one study.

    Args:
        task: The task, the name of an installed one, or a domain file; one that belongs to no
            installed task is a world, as `serp.file_task` makes it.
        **options: All but `vary` are optional.

            * `vary`: name of a setting (`learner.learning_rate`) → its values: a text (`A..B`,
              `log:A..B` or `A,B,...`), a list, or None for all values of a truth value or word.
            * `algorithm`: one of serp's algorithms; `serp` by default.
            * `objective`: `training`, the area under the training curve (the default), or
              `evaluation`, the mean return of the trained policy.
            * `trials`: number of trials; 50 by default.
            * `seeds`: how many seeds, from 1,000 on, or a list of seeds; 3 by default. Results are
              to be reported with other seeds.
            * `env_steps`: budget of each training; by default `training.env_steps` of the task.
            * `settings`: section → setting → value, for all trials.
            * `storage`: a file, or the URL of a database; by default
              `runs/tune-<domain>-<time>.db`.
            * `study`: name of the study in it; that of the task by default.
            * `prune`: end a trial after a seed if its mean so far is below the median of others.
            * `seed`: seed of the search.
            * `engine`, `address`, `jobs`: what runs the trainings, as in `serp.compare`.
            * `quiet`: show no progress.

    Raises:
        SerpError: Task, options, settings or storage are wrong, or no trial succeeded.
        Interrupted: Ctrl-C, SIGTERM or SIGHUP; the study can be continued.
    """
    if "vary" not in options:
        raise SettingsError("tune: say what to `vary`, such as {'planner.depth': '2..7'}")
    request = TuningRequest(**options)
    with needs_extra("tune", "tuning"):
        import optuna
    if not isinstance(task, Task | str):
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    search = Search(find_task(task, worlds=True) if isinstance(task, str) else task, request)
    jobs = search.jobs({})
    most = at_once(request.engine, request.jobs, len(jobs))
    here = runs_here(request.engine, jobs, most)
    storage = request.storage or f"sqlite:///{default_path(f'tune-{search.name}')}.db"
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    found = open_study(optuna, storage, request.study or search.name, search.digest)
    console = open_console(stderr=True)

    def say(text: str) -> None:
        if not request.quiet:
            console.print(text, soft_wrap=True)

    if here and most != 1:
        say(ONE_AFTER_ANOTHER)
    with ExitStack() as stack, stop_between_episodes() as stopping:
        pool = None
        if not here:
            pool = stack.enter_context(open_pool(request.engine, request.address, most))

        def stopped() -> bool:
            answer = stopping.answer("the trainings that run", "this trial is lost")
            if answer is not None:
                say(answer)
            return stopping.requested

        study = Study(optuna, found, search, pool, stopped)
        while (done := study.finished) < request.trials and not stopped():
            told = study.run_trial()
            if told is not None:
                say(f"[{done + 1}/{request.trials}] {told}")
    if stopping.signal is not None and done < request.trials:
        raise Interrupted(
            f"stopped after {done} of {request.trials} trials, which are in {storage}",
            stopping.signal,
        )
    best = study.best()
    if best is None:
        raise RunError(
            f"none of {done} trials succeeded; the first failed: {study.first_failure()}"
        )
    say(f"best: {readable(best[1])}")
    return Tuned(changes_of(best[0]), best[1], study.before(), done, found, storage)
