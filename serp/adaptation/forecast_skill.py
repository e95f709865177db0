"""How well the model in use predicts, of late."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.adaptation.moving_average import rate_of
from serp.model.transition_model import Vector

_MEMORY: Final = 0.99
_LEAST: Final = 20
"""Before so many env steps nothing is known."""
_RELIABLE: Final = 0.9
_RESTING: Final = 1e-3
"""Errors of so little of the usual squared change are none."""


@cached_njit(nogil=True)
def follow(state, predicted, observed, steps, means):  # type: ignore[no-untyped-def]
    """Let means of squared errors and changes follow a step; return 1, or 0 for one left out.

    State, prediction and observation are `[F]`, `steps` is how many there were before. `means` are
    `[3, F]`: of squared errors and changes of late, and of changes at all times.
    """
    for i in range(state.shape[0]):
        off, moved = observed[i] - predicted[i], observed[i] - state[i]
        if not (math.isfinite(off * off) and math.isfinite(moved * moved)):
            return 0
    rate, share = rate_of(steps, _MEMORY), 1.0 / (1.0 + steps)
    for i in range(state.shape[0]):
        off, moved = observed[i] - predicted[i], observed[i] - state[i]
        means[0, i] += rate * (off * off - means[0, i])
        means[1, i] += rate * (moved * moved - means[1, i])
        means[2, i] += share * (moved * moved - means[2, i])
    return 1


class ForecastSkill:
    """The share of what changes that the model foresees, by fluent.

    The skill of a forecast against persistence (Murphy, 1988): 1 less the mean squared error over
    the mean squared change. 1: everything is foreseen; 0: "nothing changes" would do as well.

    Args:
        fluents: Width of a state, F.

    Attributes:
        means: `[3, F]`, what `follow` changes.
        steps: Env steps that they are of.
    """

    def __init__(self, fluents: int) -> None:
        self.means = np.zeros((3, fluents))
        self.steps = 0
        self._error, self._change, self._usual = self.means

    def observe(self, state: Vector, predicted: Vector, observed: Vector) -> None:
        """Take a prediction into account; one with NaN or infinity is left out."""
        self.steps += follow(state, predicted, observed, self.steps, self.means)

    @property
    def reliable(self) -> bool:
        """Whether the model foresees nine tenths of what changes, of every fluent.

        A fluent that rests of late, beside what it usually does, is foreseen; one that never
        changed is, unless it was predicted to.
        """
        if self.steps < _LEAST:
            return False
        missed = self._error > (1.0 - _RELIABLE) * self._change
        return not bool((missed & (self._error > _RESTING * self._usual)).any())

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        return {"means": self.means.copy()}, {"steps": self.steps}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It belongs to another domain, or is damaged.
        """
        saved = Saved("skill of the model", arrays, meta)
        means = saved.array("means", np.float64, self.means.shape, low=0.0)
        self.means[:], self.steps = means, saved.whole("steps")
