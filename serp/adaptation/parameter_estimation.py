"""Estimating the literals of a file anew while a run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.parameter_dependencies import parameter_dependencies
from serp.sysid.parameter_fit import ParameterEstimator, estimate_parameters
from serp.sysid.regression_data import predictions, usable_rows
from serp.sysid.transitions import TransitionMemory

Actions = NDArray[np.int64]

_FIRST: Final = 32
"""Env steps before the first estimate; it is made anew whenever there are twice as many."""
_MOST: Final = 4_000
"""Newest transitions that an estimate rests on."""
_SHOWN: Final = 0.7
"""Share of them, the oldest, that an estimate is made from which the others then judge."""
_FORESEEN: Final = 0.5
"""Where an estimate leaves less of the squared change than that, it is believed whatever it is."""
_LEFT: Final = 0.25
"""Share of a written number that stays where it is not. An effect that comes about at times and at
times does not has a small mean, which is nothing that happens; planned with, it is no effect."""
_CERTAIN: Final = 0.02
"""The same as `_FORESEEN`, of the error of those in use, whatever changes."""
_MOVES: Final = 0.01
"""An estimate that differs by less than its standard error, or this share, is no news: what was
learned beside the literals in use would be lost for nothing."""
_USUAL: Final = 0.98
_NOBODY: Final = 25.0
"""A step is left out whose least squared error is so many times this quantile of all."""
_BETTER: Final = 0.9
"""An estimate is adopted instead of what is written where its squared error is smaller by this
factor, and instead of an earlier estimate where it is smaller."""


class ParameterEstimation:
    """Says what the literals in use should be.

    Literals that change the fluents of one function are adopted together, and only where those
    estimated from earlier transitions have predicted the later ones better than those in use.

    Args:
        written: The model as written; where it is compiled already, that is made use of.
    """

    def __init__(self, written: TransitionModel) -> None:
        self._written = written
        compiled = written if written.compiled else None
        self._estimator = ParameterEstimator(written.ground, written.dt, compiled)
        self._owned: dict[str, list[int]] = {}
        for influence in parameter_dependencies(written.ground):
            self._owned.setdefault(influence.symbol, []).append(influence.parameter.index)

    @staticmethod
    def due(seen: int) -> bool:
        """Return whether it is time, after so many env steps: at 32, 64, 128 and so on."""
        return seen >= _FIRST and seen & (seen - 1) == 0

    def reconsider(self, experience: TransitionMemory, theta: Vector) -> Vector:
        """Return the literals to use from now on.

        Args:
            experience: The transitions.
            theta: `[P]` literals in use.
        """
        states, next_states = experience.states[-_MOST:], experience.next_states[-_MOST:]
        actions = experience.actions[-_MOST:]
        first = int(_SHOWN * len(actions))
        earlier, _ = self._estimate(states[:first], actions[:first], next_states[:first], theta)
        latest, errors = self._estimate(states, actions, next_states, theta)
        known = usable_rows(self._written, states, actions, next_states)
        known = known[known >= first]
        later = states[known], actions[known], next_states[known]
        held = self._held(earlier)
        now, full, part, change = self._errors((theta, earlier, held), *later)
        adopted = theta.copy()
        for symbol, owned in self._owned.items():
            columns = list(self._estimator.symbols.get(symbol, ()))
            spoken = [k for k in owned if np.isfinite(errors[k])]
            if not spoken:
                continue
            worth = now[columns].sum()
            foreseen = max(_FORESEEN * change[columns].sum(), _CERTAIN * worth)
            believed = full[columns].sum() < foreseen
            error = (full if believed else part)[columns].sum()
            estimated = (theta[owned] != self._written.theta[owned]).any()
            if error < (1.0 if estimated else _BETTER) * worth:
                news = (latest if believed else self._held(latest))[spoken]
                least = np.maximum(errors[spoken], _MOVES * np.abs(theta[spoken]))
                if (np.abs(news - theta[spoken]) > least).any():
                    adopted[spoken] = news
        return adopted

    def _held(self, theta: Vector) -> Vector:
        """Return `[P]` literals that are nowhere much smaller than written, nor of other sign.

        What is written as 0 has no sign.
        """
        written = self._written.theta
        sign = np.where(written < 0.0, -1.0, 1.0)
        held: Vector = sign * np.maximum(sign * theta, _LEFT * np.abs(written))
        return np.where(written == 0.0, theta, held)

    def _estimate(
        self, states: Vector, actions: Actions, next_states: Vector, theta: Vector
    ) -> tuple[Vector, Vector]:
        model = self._written.replace(theta=theta)
        return estimate_parameters(model, states, actions, next_states, estimator=self._estimator)

    def _errors(
        self, candidates: Sequence[Vector], states: Vector, actions: Actions, next_states: Vector
    ) -> Vector:
        """Return `[C + 1, F]` sums of squared errors of literals and of "nothing changes".

        They are over the same steps for all. A step that the first candidate predicts and another
        one does not counts for that as an error beyond all bounds, or literals would be better the
        less they say.
        """
        off = np.array(
            [
                next_states - predictions(self._written.replace(theta=theta), states, actions)
                for theta in candidates
            ]
            + [next_states - states]
        )
        squared = off * off
        # What nobody comes near says nothing about who is better.
        best = np.where(np.isfinite(squared), squared, 0.0).min(axis=0)
        if len(best):
            squared[:, best > _NOBODY * np.quantile(best, _USUAL, axis=0)] = 0.0
        known = np.isfinite(squared)
        errors = np.where(known, squared, np.inf)
        errors[:, ~known[0]] = 0.0
        sums: Vector = errors.sum(axis=1)
        return sums
