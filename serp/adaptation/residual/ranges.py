"""The ranges of the inputs of a regression, by which they are normalised."""

from __future__ import annotations

from typing import Final

import numpy as np

from serp.adaptation.residual.parameters import RANGE
from serp.model.transition_model import Vector

_FEW, _SETTLED = 5, 30
"""Samples before which no input counts as an outlier, and before which only extreme ones do."""
_FAR, _EXTREME = 8.0, 100.0
"""An input is an outlier so many half ranges from the middle of its range."""
_PATIENCE: Final = 3
"""After more successive outliers the environment is assumed to have changed."""


class Ranges:
    """The ranges of `d` inputs.

    Attributes:
        low, high: `[d]` ends of the ranges; infinite at first.
        outliers: Number of successive outliers.
    """

    def __init__(self, depth: int) -> None:
        self.low, self.high = np.empty(depth), np.empty(depth)
        self.clear()

    def clear(self) -> None:
        """Forget the ranges."""
        self.low[:], self.high[:] = np.inf, -np.inf
        self.outliers = 0

    def accept(self, x: Vector, seen: int) -> bool:
        """Widen the ranges to an input, or return False for an outlier; `seen` inputs were before.

        After several outliers in a row they are accepted.
        """
        far = False
        if seen >= _FEW:
            centre, half = self.centre_and_half()
            limit = _FAR if seen >= _SETTLED else _EXTREME
            far = bool((np.abs(x - centre) > limit * half).any())
        self.outliers = self.outliers + 1 if far else 0
        if 0 < self.outliers <= _PATIENCE:
            return False
        np.minimum(self.low, x, out=self.low)
        np.maximum(self.high, x, out=self.high)
        return True

    def centre_and_half(self) -> tuple[Vector, Vector]:
        """Return the centres of the ranges and half their widths, 1 for what never changed."""
        centre, half = (self.high + self.low) / 2, (self.high - self.low) / 2
        half[half <= 1e-9 * np.maximum(1.0, np.abs(centre))] = 1.0
        return centre, half

    def beyond(self, centre: Vector, shrink: Vector) -> bool:
        """Return whether a range is much wider than the one that inputs are normalised by."""
        ends = np.maximum(self.high - centre, centre - self.low) * shrink
        return not shrink.all() or bool((ends > RANGE).any())
