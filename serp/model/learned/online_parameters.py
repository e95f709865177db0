"""Estimation of a file's parameters during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.learned.parameter_fit import (
    ParameterEstimator,
    estimate_parameters,
    function_columns,
)
from serp.model.learned.regression_data import predictions, usable_rows
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector

_EARLY = 3.0
"""The n-th sample initially has the weight 3 / (2 + n), so that early samples soon lose weight."""


@cached_njit(nogil=True)
def rate_of(samples, memory):  # type: ignore[no-untyped-def]
    """Return the weight of the next sample; `memory` is that of the past in the long run."""
    return max(1.0 - memory, _EARLY / (_EARLY + samples))


Actions = NDArray[np.int64]

_FIRST, _NEWEST = 32, 4_000
"""Env steps before the first estimate, which is repeated whenever their number has doubled; and the
most transitions, the newest, of an estimate."""
_FITTED: Final = 0.7
"""Fraction of these, the oldest, that a first estimate is fitted to; the others validate it."""
_BETTER: Final = 0.9
"""An estimate replaces a written value where its squared error is smaller by this factor, and an
earlier estimate where it is smaller."""
_PREDICTED, _CERTAIN = 0.5, 0.02
"""An estimate may have any value if it leaves less than this fraction of the squared change, or of
the squared error of the parameters in use; otherwise it is bounded, see `_LEAST`."""
_LEAST: Final = 0.25
"""Least fraction of a written value that a bounded estimate keeps. The mean of a rare effect is
small and never observed itself; a plan with the mean would ignore the effect."""
_SMALL_CHANGE: Final = 0.01
"""Relative change of a parameter that is ignored, as is one within its standard error: a change
resets everything that was learned beside the parameters."""
_USUAL, _OUTLIER = 0.98, 25.0
"""A step is left out if its least squared error is this many times this quantile of all."""


class ParameterEstimation:
    """Decides which parameters to use.

    Parameters that change the fluents of one function are adopted together, and only if estimates
    from earlier transitions predict later ones better than the parameters in use.
    """

    def __init__(self, written: TransitionModel) -> None:
        self._written = written
        self._estimator = ParameterEstimator(written)
        self._columns = function_columns(written.ground)
        self._owned: dict[str, list[int]] = {}
        for dependency in self._estimator.dependencies:
            self._owned.setdefault(dependency.symbol, []).append(dependency.parameter.index)

    @staticmethod
    def due(seen: int) -> bool:
        """Return whether an estimate is due after `seen` env steps: at 32, 64, 128 and so on."""
        return seen >= _FIRST and seen & (seen - 1) == 0

    def reconsider(self, experience: TransitionMemory, theta: Vector) -> Vector:
        """Return the parameters to use from now on, instead of `theta` `[P]`."""
        states, next_states = experience.states[-_NEWEST:], experience.next_states[-_NEWEST:]
        actions = experience.actions[-_NEWEST:]
        first = int(_FITTED * len(actions))
        model = self._written.replace(theta=theta)
        (earlier, _), (latest, errors) = (
            estimate_parameters(self._estimator, model, states[:n], actions[:n], next_states[:n])
            for n in (first, len(actions))
        )
        rows, _ = usable_rows(self._written, states, actions, next_states)
        rows = rows[rows >= first]
        now, free, bounded, change = self._errors(
            (theta, earlier, self._bounded(earlier)), states[rows], actions[rows], next_states[rows]
        )
        adopted = theta.copy()
        for symbol, owned in self._owned.items():
            columns = self._columns.get(symbol, [])
            known = [k for k in owned if np.isfinite(errors[k])]
            if not known:
                continue
            in_use = now[columns].sum()
            enough = max(_PREDICTED * change[columns].sum(), _CERTAIN * in_use)
            believed = free[columns].sum() < enough
            error = (free if believed else bounded)[columns].sum()
            estimated = (theta[owned] != self._written.theta[owned]).any()
            if error < (1.0 if estimated else _BETTER) * in_use:
                news = (latest if believed else self._bounded(latest))[known]
                least = np.maximum(errors[known], _SMALL_CHANGE * np.abs(theta[known]))
                if (np.abs(news - theta[known]) > least).any():
                    adopted[known] = news
        return adopted

    def _bounded(self, theta: Vector) -> Vector:
        """Return parameters `[P]` that keep the written sign and a fraction of the written size.

        A parameter that is written as 0 is not bounded.
        """
        written = self._written.theta
        sign = np.where(written < 0.0, -1.0, 1.0)
        bounded: Vector = sign * np.maximum(sign * theta, _LEAST * np.abs(written))
        return np.where(written == 0.0, theta, bounded)

    def _errors(
        self, candidates: Sequence[Vector], states: Vector, actions: Actions, next_states: Vector
    ) -> Vector:
        """Return sums of squared errors of C candidates and of "nothing changes", `[C + 1, F]`.

        All sums are over the same steps. A candidate without a prediction for a step that the first
        candidate predicts has an infinite error; fewer predictions must not be an advantage.
        """
        off = np.array(
            [
                next_states - predictions(self._written.replace(theta=theta), states, actions)
                for theta in candidates
            ]
            + [next_states - states]
        )
        squared = off * off
        # Steps that all candidates predict badly do not distinguish them.
        best = np.where(np.isfinite(squared), squared, 0.0).min(axis=0)
        if len(best):
            squared[:, best > _OUTLIER * np.quantile(best, _USUAL, axis=0)] = 0.0
        known = np.isfinite(squared)
        errors = np.where(known, squared, np.inf)
        errors[:, ~known[0]] = 0.0
        sums: Vector = errors.sum(axis=1)
        return sums
