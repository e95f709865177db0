"""The first samples of a group, kept until it can be told which of them were wild.

Before anything is known of a group no outlier can be told, so its first samples are all learned
from. One wild reading among them would stretch the ranges of the inputs, and be all that the
regression minds, for thousands of samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.adaptation.residual.outliers import HUGE

Array = NDArray[np.float64]
Truths = NDArray[np.bool_]

_MANY: Final = 10
_FEW: Final = 6
"""Of fewer numbers none is wild."""
_SPARED: Final = 2
"""Numbers may be wild at most; one wild reading spoils what is said of two steps."""
_WILD: Final = 30.0
"""So many times the distance of all others from the median."""


class WarmUp:
    """The first ten samples.

    Args:
        depth: Inputs, d.
        places: `[T]` where each target stands among the inputs.
    """

    def __init__(self, depth: int, places: NDArray[np.int64]) -> None:
        self._places = places
        self._x = np.zeros((_MANY, depth))
        self._y, self._change = np.zeros((2, _MANY, len(places)))
        self._valid = np.zeros((_MANY, len(places)), dtype=np.bool_)
        self._kept = 0

    @property
    def over(self) -> bool:
        """Whether all of them have come."""
        return self._kept == _MANY

    def add(self, x: Array, y: Array, valid: Truths, change: Array) -> None:
        """Keep a sample; see `serp.adaptation.residual.residual.Residual.learn`."""
        k = self._kept
        self._x[k], self._y[k], self._valid[k], self._change[k] = x, y, valid, change
        self._kept += 1

    def without_wild(
        self, alike: Sequence[WarmUp]
    ) -> Iterator[tuple[Array, Array, Truths, Array]] | None:
        """Return the samples less what is wild in them; None where nothing is.

        What has a wild input goes altogether, of the others what is said of a target whose own
        number is wild. A target is measured by how much it is off in all other samples, or by how
        much its fluent varies, if that is more.

        Args:
            alike: Those of groups with the same inputs, this one included: one action alone may be
                taken in few places.
        """
        seen = np.concatenate([other._x[: other._kept] for other in alike])
        strange = np.zeros(len(self._x), dtype=np.bool_)
        spreads = np.zeros(seen.shape[1])
        for i in range(len(spreads)):
            median, spreads[i] = _usual(seen[:, i])
            strange |= _wild(self._x[:, i], median, spreads[i])
        valid = self._valid & (np.abs(self._y) < HUGE) & ~strange[:, None]
        believed = valid.copy()
        for t, place in enumerate(self._places):
            rows = np.flatnonzero(valid[:, t])
            if len(rows) >= _FEW:
                off = self._y[rows, t]
                median, spread = _usual(off)
                believed[rows[_wild(off, median, max(spread, spreads[place]))], t] = False
        if not strange.any() and (believed == valid).all():
            return None
        return (
            (self._x[k], self._y[k], believed[k], self._change[k]) for k in np.flatnonzero(~strange)
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return arrays that `load_state_dict` restores exactly."""
        return {name: getattr(self, f"_{name}")[: self._kept].copy() for name in self._STATE}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It belongs to another domain, or is damaged.
        """
        saved = Saved("first samples", arrays, {})
        kept = min(len(arrays["x"]), _MANY) if saved.has("x") and arrays["x"].ndim else 0
        for name in self._STATE:
            own = getattr(self, f"_{name}")
            # Any numbers: what is wild among them is what these samples are kept for.
            own[:kept] = saved.array(name, own.dtype, (kept, *own.shape[1:]), low=None)
        self._kept = kept

    _STATE = ("x", "y", "valid", "change")


def _usual(values: Array) -> tuple[float, float]:
    """Return the median, and how far all but a few numbers are from it at most."""
    median = float(np.median(values))
    return median, float(np.sort(np.abs(values - median))[-1 - _SPARED])


def _wild(values: Array, median: float, spread: float) -> Truths:
    """Return which of some successive numbers are wild.

    What never changed counts as if its spread were 1. At the end, something else may begin.
    """
    if spread <= 1e-9 * max(1.0, abs(median)):
        spread = 1.0
    wild: Truths = np.abs(values - median) > _WILD * spread
    last = len(values)
    while last and wild[last - 1]:
        last -= 1
    wild[last:] = False
    return wild
