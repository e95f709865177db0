"""Outliers among the first samples, found together: one alone would dominate a regression."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import Vector

Mask = NDArray[np.bool_]

FIRST: Final = 10
_MIN_NUMBERS: Final = 6  # fewest numbers among which outliers can be identified
_SPARED: Final = 2  # most outliers; one wrong reading affects two steps
_EXTREME: Final = 30.0
"""An outlier is this many times as far from the median as the farthest other number."""


def outliers(
    x: Vector, seen: Vector, y: Vector, valid: Mask, places: NDArray[np.int64]
) -> tuple[Mask, Mask]:
    """Return which of n samples to drop `[n]`, and which targets of the others to use `[n, T]`.

    The scale of a target is that of the other samples, or that of its fluent if larger. `seen` are
    the inputs of all actions: a single one may have been executed in few states. `places` `[T]` are
    the positions of the targets among the inputs.
    """
    dropped = np.zeros(len(x), dtype=np.bool_)
    spreads = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        median, spreads[i] = _median_and_spread(seen[:, i])
        dropped |= _outliers(x[:, i], median, spreads[i])
    used = valid & ~dropped[:, None]
    for t, place in enumerate(places):
        rows = np.flatnonzero(used[:, t])
        if len(rows) >= _MIN_NUMBERS:
            off = y[rows, t]
            median, spread = _median_and_spread(off)
            used[rows[_outliers(off, median, max(spread, spreads[place]))], t] = False
    return dropped, used


def _median_and_spread(values: Vector) -> tuple[float, float]:
    """Return the median, and the largest distance from it of all but a few numbers."""
    median = float(np.median(values))
    return median, float(np.sort(np.abs(values - median))[-1 - min(_SPARED, len(values) - 1)])


def _outliers(values: Vector, median: float, spread: float) -> Mask:
    """Return which of successive numbers are outliers; never the last, where a change may begin.

    Numbers that never changed have a spread of 1.
    """
    if spread <= 1e-9 * max(1.0, abs(median)):
        spread = 1.0
    found: Mask = np.abs(values - median) > _EXTREME * spread
    last = len(values)
    while last and found[last - 1]:
        last -= 1
    found[last:] = False
    return found
