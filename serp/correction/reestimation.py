"""Estimating the literals of a file anew while a run goes on."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.correction.experience import Experience
from serp.correction.influence import influences
from serp.correction.literals import LiteralEstimator, estimate_literals
from serp.correction.sample import predictions
from serp.domain.model import TransitionModel, Vector

Actions = NDArray[np.int64]

_FIRST: Final = 32
"""Env steps before the first estimate; it is made anew whenever there are twice as many."""
_MOST: Final = 4_000
"""Newest transitions that an estimate rests on."""
_SHOWN: Final = 0.7
"""Share of them, the oldest, that an estimate is made from which the others then judge."""
_FORESEEN: Final = 0.5
"""Share of the squared change that may be left; the mean of things that differ widely is nothing
that happens, and no plan can be built on it."""
_CERTAIN: Final = 0.02
"""The same of the error of those in use, whatever changes."""
_BETTER: Final = 0.9
"""An estimate is adopted where its squared error is smaller by this factor."""


class Reestimation:
    """Says what the literals in use should be.

    Literals that change the fluents of one function are adopted together, and only where those
    estimated from earlier transitions have predicted the later ones better than those in use.

    Args:
        written: The model as written; where it is compiled already, that is made use of.
    """

    def __init__(self, written: TransitionModel) -> None:
        self._written = written
        compiled = written if written.compiled else None
        self._estimator = LiteralEstimator(written.ground, written.dt, compiled)
        self._owned: dict[str, list[int]] = {}
        for influence in influences(written.ground):
            self._owned.setdefault(influence.symbol, []).append(influence.parameter.index)

    @staticmethod
    def due(seen: int) -> bool:
        """Return whether it is time, after so many env steps: at 32, 64, 128 and so on."""
        return seen >= _FIRST and seen & (seen - 1) == 0

    def reconsider(self, experience: Experience, theta: Vector) -> Vector:
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
        known = actions >= 0
        known[:first] = False
        moved = next_states[known] - states[known]
        change = np.nansum(moved * moved, axis=0)
        now = self._errors(theta, states[known], actions[known], next_states[known])
        then = self._errors(earlier, states[known], actions[known], next_states[known])
        adopted = theta.copy()
        for symbol, owned in self._owned.items():
            columns = list(self._estimator.symbols.get(symbol, ()))
            spoken = [k for k in owned if np.isfinite(errors[k])]
            error, worth = then[columns].sum(), now[columns].sum()
            foreseen = max(_FORESEEN * change[columns].sum(), _CERTAIN * worth)
            if spoken and error < min(_BETTER * worth, foreseen):
                adopted[spoken] = latest[spoken]
        return adopted

    def _estimate(
        self, states: Vector, actions: Actions, next_states: Vector, theta: Vector
    ) -> tuple[Vector, Vector]:
        model = self._written.replace(theta=theta)
        return estimate_literals(model, states, actions, next_states, estimator=self._estimator)

    def _errors(
        self, theta: Vector, states: Vector, actions: Actions, next_states: Vector
    ) -> Vector:
        """Return `[F]` sums of squared errors."""
        model = self._written.replace(theta=theta)
        off = next_states - predictions(model, states, actions)
        errors: Vector = np.nansum(off * off, axis=0)
        return errors
