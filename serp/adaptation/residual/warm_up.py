"""The first samples of a group, kept until outliers among them can be identified.

At first a group learns from all samples. One outlier among them would stretch the ranges of the
inputs and dominate the regression for thousands of samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.adaptation.residual.outliers import HUGE
from serp.model.transition_model import Vector

Mask = NDArray[np.bool_]

_SAMPLES: Final = 10
_MIN_NUMBERS: Final = 6  # fewest numbers among which outliers can be identified
_SPARED: Final = 2  # most outliers; one wrong reading affects two steps
_EXTREME: Final = 30.0
"""An outlier is this many times as far from the median as the farthest other number."""


class WarmUp:
    """The first ten samples; `places` `[T]` are the positions of the targets among the d inputs."""

    def __init__(self, depth: int, places: NDArray[np.int64]) -> None:
        self._places = places
        self._x = np.zeros((_SAMPLES, depth))
        self._y, self._change = np.zeros((2, _SAMPLES, len(places)))
        self._valid = np.zeros((_SAMPLES, len(places)), dtype=np.bool_)
        self._kept = 0

    @property
    def over(self) -> bool:
        """Whether all samples were added."""
        return self._kept == _SAMPLES

    def add(self, x: Vector, y: Vector, valid: Mask, change: Vector) -> None:
        """Keep a sample; see `OnlineResidual.learn`."""
        k = self._kept
        self._x[k], self._y[k], self._valid[k], self._change[k] = x, y, valid, change
        self._kept += 1

    def without_outliers(
        self, alike: Sequence[WarmUp]
    ) -> Iterator[tuple[Vector, Vector, Mask, Vector]] | None:
        """Return the samples without outliers; None if there are no outliers.

        A sample with an outlying input is dropped; one with an outlying target is kept without
        this target. The scale of a target is that of the other samples, or that of its fluent if
        larger. `alike` are warm-ups of groups with the same inputs, this one included: a single
        action may have been executed in few states.
        """
        seen = np.concatenate([other._x[: other._kept] for other in alike])
        dropped = np.zeros(len(self._x), dtype=np.bool_)
        spreads = np.zeros(seen.shape[1])
        for i in range(len(spreads)):
            median, spreads[i] = _median_and_spread(seen[:, i])
            dropped |= _outliers(self._x[:, i], median, spreads[i])
        valid = self._valid & (np.abs(self._y) < HUGE) & ~dropped[:, None]
        used = valid.copy()
        for t, place in enumerate(self._places):
            rows = np.flatnonzero(valid[:, t])
            if len(rows) >= _MIN_NUMBERS:
                off = self._y[rows, t]
                median, spread = _median_and_spread(off)
                used[rows[_outliers(off, median, max(spread, spreads[place]))], t] = False
        if not dropped.any() and (used == valid).all():
            return None
        return (
            (self._x[k], self._y[k], used[k], self._change[k]) for k in np.flatnonzero(~dropped)
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return arrays that `load_state_dict` restores exactly."""
        return {name: getattr(self, f"_{name}")[: self._kept].copy() for name in self._SAVED}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("first samples", arrays, {})
        kept = min(len(arrays["x"]), _SAMPLES) if saved.has("x") and arrays["x"].ndim else 0
        for name in self._SAVED:
            own = getattr(self, f"_{name}")
            own[:kept] = saved.array(name, own.dtype, (kept, *own.shape[1:]), low=None)
        self._kept = kept

    _SAVED = ("x", "y", "valid", "change")


def _median_and_spread(values: Vector) -> tuple[float, float]:
    """Return the median, and the largest distance from it of all but a few numbers."""
    median = float(np.median(values))
    return median, float(np.sort(np.abs(values - median))[-1 - _SPARED])


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
