"""A study of Optuna, a trial at a time."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.number_format import readable
from serp.comparison.workers import Pool
from serp.errors import RunError, SerpError
from serp.tuning.search import Search
from serp.tuning.space import Dimension, changes_of

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
