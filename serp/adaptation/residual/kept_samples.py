"""The newest samples of a regression, kept to learn from again when ranges have grown."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import LARGEST, Saved
from serp.model.transition_model import Vector

Mask = NDArray[np.bool_]

_KEPT: Final = 4096


class KeptSamples:
    """A ring of samples; `d` inputs, `T` targets, rows of the regression below `rows`.

    Attributes:
        x, y, change, valid: Inputs, errors, changes and whether these are observed.
        row, weight: Row and weight in the regression.
        seen: Number of samples ever added.
    """

    def __init__(self, depth: int, count: int, rows: int) -> None:
        self.x = np.zeros((_KEPT, depth))
        self.y, self.change = np.zeros((2, _KEPT, count))
        self.valid = np.zeros((_KEPT, count), dtype=np.bool_)
        self.row, self.weight = np.zeros(_KEPT, dtype=np.int64), np.zeros(_KEPT)
        self.seen = 0
        self._rows = rows

    def __len__(self) -> int:
        return min(self.seen, _KEPT)

    def add(
        self, x: Vector, y: Vector, valid: Mask, change: Vector, place: tuple[int, float]
    ) -> None:
        """Add a sample; `place` is its row and its weight."""
        at = self.seen % _KEPT
        self.x[at], self.y[at], self.valid[at], self.change[at] = x, y, valid, change
        self.row[at], self.weight[at] = place
        self.seen += 1

    def newest(self, count: int) -> NDArray[np.int64]:
        """Return the positions of the newest samples, in order of time."""
        return np.arange(self.seen - count, self.seen) % _KEPT

    def age(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how many samples are newer than each of some positions."""
        return (self.seen - 1 - rows) % _KEPT

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return arrays that `load_state_dict` restores exactly."""
        return {name: getattr(self, name)[: len(self)].copy() for name in self._SAVED}

    def load_state_dict(self, saved: Saved, seen: int) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        self.seen = seen
        ranges = {"x": (-LARGEST, LARGEST), "row": (0, self._rows - 1), "weight": (0.0, 1.0)}
        for name in self._SAVED:
            own = getattr(self, name)[: len(self)]
            low, high = ranges.get(name, (None, LARGEST))  # not finite where it is not valid
            own[:] = saved.array(name, own.dtype, own.shape, low, high)

    _SAVED = ("x", "y", "change", "valid", "row", "weight")
