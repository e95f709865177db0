"""The value of the states at the end of a lookahead: an estimate for compiled loops.

It turns the values that a learner estimates from observations into a function of the state only.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.transition_model import Vector
from serp.planning.far_sight.cell_values import CELLS, KIND, cell_value_at

FEATURES: Final = 64
_BANDWIDTH: Final = 0.7
"""Standard deviation of the frequencies, for fluents of unit deviation."""
_NORMAL: Final = 3.29
"""Distance between the quantiles of a normal distribution, in standard deviations."""
_RIDGE: Final = 1e-4

_WAVES, _LOW, _HIGH, _CONSTANT, _HEADER = 0, 1, 2, 3, 4


@cached_njit(nogil=True)
def value_at(packed, states, at, width):  # type: ignore[no-untyped-def]
    """Return the value of the state of `width` numbers that begins in flat `states` at `at`."""
    if packed[KIND] == CELLS:
        return cell_value_at(packed, states, at, width)
    waves = int(packed[_WAVES])
    centre = _HEADER
    scale = centre + width
    phase = scale + width
    amplitude = phase + waves
    frequency = amplitude + waves
    value = packed[_CONSTANT]
    for k in range(waves):
        z = packed[phase + k]
        for i in range(width):
            x = (states[at + i] - packed[centre + i]) * packed[scale + i]
            z += packed[frequency + k * width + i] * x
        value += packed[amplitude + k] * math.cos(z)
    if value > packed[_HIGH]:
        return packed[_HIGH]
    return value if value >= packed[_LOW] else packed[_LOW]  # NaN as well


class LeafValue:
    """A value function of states `[F]`, fitted to the values of some states.

    Ridge regression on random Fourier features (Rahimi & Recht 2007). The value is clipped to the
    range of the values that it was fitted to. `packed`, which `value_at` reads, is empty before the
    first fit.
    """

    def __init__(self, fluents: int, seed: np.random.SeedSequence) -> None:
        random = np.random.default_rng(seed)
        self._fluents = fluents
        self._frequency = _BANDWIDTH * random.standard_normal((FEATURES, fluents))
        self._phase = random.uniform(0.0, 2.0 * np.pi, FEATURES)
        self.packed: Vector = np.zeros(0)

    @property
    def fitted(self) -> bool:
        """Whether `fit` has succeeded."""
        return self.packed.size > 0

    def restore(self, packed: Vector) -> None:
        """Restore a saved `packed`, or raise a ValueError if it is of states of another width."""
        size = _HEADER + 2 * self._fluents + FEATURES * (2 + self._fluents)
        if packed.size and (packed.shape != (size,) or packed[_WAVES] != FEATURES):
            raise ValueError(f"{packed.shape} instead of {(size,)}")
        self.packed = np.array(packed, dtype=np.float64)

    def of(self, state: Vector) -> float:
        """Return the value of a state `[F]`, after a fit."""
        return float(value_at(self.packed, state, 0, self._fluents))

    def fit(self, states: Vector, values: Vector) -> None:
        """Fit the estimate anew to states `[N, F]` and their values `[N]`, N ≥ 1.

        Where a number is not finite (the learner may diverge), or the regression has no solution,
        the previous estimate is kept.
        """
        if not (np.isfinite(states).all() and np.isfinite(values).all()):
            return
        # By quantiles: a single outlier would make all other inputs nearly equal.
        low, centre, high = np.quantile(states, (0.05, 0.5, 0.95), axis=0)
        spread = np.where(high > low, (high - low) / _NORMAL, states.std(axis=0))
        rests = spread <= 1e-9 * np.maximum(1.0, np.abs(centre))
        scale = np.where(rests, 0.0, 1.0 / np.where(rests, 1.0, spread))
        features = np.cos((states - centre) * scale @ self._frequency.T + self._phase)
        mean, middle = values.mean(), features.mean(axis=0)
        features -= middle
        gram = features.T @ features
        gram[np.diag_indices_from(gram)] += _RIDGE * len(states)
        try:
            amplitude: NDArray[np.floating] = np.linalg.solve(gram, features.T @ (values - mean))
        except np.linalg.LinAlgError:
            return
        self.packed = np.concatenate(
            (
                (FEATURES, values.min(), values.max(), mean - middle @ amplitude),
                centre, scale, self._phase, amplitude, self._frequency.ravel(),
            )
        )  # fmt: skip
