"""Forecast skill: the recent accuracy of the model in use."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.adaptation.moving_average import rate_of

_MEMORY: Final = 0.99  # weight of the past in the moving averages, per step
_MIN_STEPS: Final = 20
_RELIABLE: Final = 0.9
"""Fraction of each fluent's squared change that a reliable model predicts, after these steps."""
_NEGLIGIBLE: Final = 1e-3  # fraction of the usual squared change below which an error is ignored


@cached_njit(nogil=True)
def update_means(state, predicted, observed, steps, means):  # type: ignore[no-untyped-def]
    """Add a step to the means `[3, F]`; return 1, or 0 if it is skipped: NaN, or squares overflow.

    All states are `[F]`; `steps` is the number of earlier steps.
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
    """The forecast skill of the model relative to persistence, by fluent.

    It is 1 minus the mean squared error over the mean squared change (Murphy, Monthly Weather
    Review 116, 1988): 1 for perfect predictions, 0 if "nothing changes" is as good.

    Attributes:
        means: `[3, F]` moving averages of squared errors and changes, mean squared change of all
            steps.
        steps: Number of env steps in them.
    """

    def __init__(self, fluents: int) -> None:
        self.means = np.zeros((3, fluents))
        self.steps = 0

    @property
    def reliable(self) -> bool:
        """Whether the model predicts nine tenths of what changes, of every fluent.

        Small errors of a fluent that currently does not change are ignored, as are fluents that
        neither change nor are predicted to.
        """
        if self.steps < _MIN_STEPS:
            return False
        error, change, usual = self.means
        missed = error > (1.0 - _RELIABLE) * change
        return not bool((missed & (error > _NEGLIGIBLE * usual)).any())

    def by_symbol(self, symbols: Sequence[str]) -> dict[str, float | None]:
        """Return the skill of the fluents of each symbol; None for those that do not change.

        `symbols` `[F]` are those of the fluents.
        """
        errors: dict[str, float] = dict.fromkeys(symbols, 0.0)
        changes: dict[str, float] = dict.fromkeys(symbols, 0.0)
        for symbol, error, change in zip(symbols, *self.means[:2].tolist(), strict=True):
            errors[symbol] += error
            changes[symbol] += change
        return {s: 1.0 - errors[s] / changes[s] if changes[s] > 0.0 else None for s in errors}

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        return {"means": self.means.copy()}, {"steps": self.steps}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("forecast skill", arrays, meta)
        means = saved.array("means", np.float64, self.means.shape, low=0.0)
        self.means[:], self.steps = means, saved.whole("steps")
