"""Estimation of a file's parameters during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.model.learned.parameter_fit import (
    ParameterEstimator,
    estimate_parameters,
    function_columns,
)
from serp.model.learned.regression_data import predictions, usable_rows
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector

_LEAST: Final = 0.25
"""Least fraction of a written value that a bounded estimate keeps. The mean of a rare effect is
small and never observed itself; a plan with the mean would ignore the effect."""


class ParameterEstimation:
    """Decides which parameters to use.

    Parameters that change the fluents of one function are adopted together, and only if estimates
    from the first 70 % of the newest 4,000 transitions predict the others better than the
    parameters in use: by 10 % where these are as written.

    An estimate may have any value if it leaves less than half of the squared change, or 2 % of the
    squared error of the parameters in use; otherwise it is bounded, see `_LEAST`.
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
        return seen >= 32 and seen & (seen - 1) == 0

    def reconsider(self, experience: TransitionMemory, theta: Vector) -> Vector:
        """Return the parameters to use from now on, instead of `theta` `[P]`."""
        newest = slice(-4_000, None)
        states, next_states = experience.states[newest], experience.next_states[newest]
        actions = experience.actions[newest]
        first = int(0.7 * len(actions))
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
            enough = max(0.5 * change[columns].sum(), 0.02 * in_use)
            believed = free[columns].sum() < enough
            error = (free if believed else bounded)[columns].sum()
            estimated = (theta[owned] != self._written.theta[owned]).any()
            if error < (1.0 if estimated else 0.9) * in_use:
                news = (latest if believed else self._bounded(latest))[known]
                # A change resets everything that was learned beside the parameters.
                least = np.maximum(errors[known], 0.01 * np.abs(theta[known]))
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
        self,
        candidates: Sequence[Vector],
        states: Vector,
        actions: NDArray[np.int64],
        next_states: Vector,
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
            squared[:, best > 25.0 * np.quantile(best, 0.98, axis=0)] = 0.0
        known = np.isfinite(squared)
        errors = np.where(known, squared, np.inf)
        errors[:, ~known[0]] = 0.0
        sums: Vector = errors.sum(axis=1)
        return sums
