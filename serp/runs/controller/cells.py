"""Values of cells of the state space, with which the far-sighted planner values its last layer.

The arithmetic is that of `serp.planning.far_sight.cell_values`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .reading import Arrays

_START, _FACTOR = np.uint64(0xCBF29CE484222325), np.uint64(0x9E3779B97F4A7C15)
_FAR, AREAS, MARGIN = 1e9, 8.0, 2.0

Rows = NDArray[np.float64]
Digests = NDArray[np.uint64]


class CellTable:
    """The cells of a planner, and their values."""

    def __init__(self, arrays: Arrays, width: int) -> None:
        found = arrays.under("cells.")
        self._low, self._scale, self._area = (
            found.numbers(name, width) for name in ("low", "scale", "area")
        )
        self._value = found.numbers("value", None)
        if not len(self._value):
            raise found.wrong("value", "is empty")
        count = len(self._value) - 1
        self._states = found.numbers("states", count * width).reshape(count, width)
        self._divided = np.flatnonzero(self._scale > 0.0).tolist()
        self._cells = {d: k for k, d in enumerate(self._digests(self._states, True).tolist())}
        self._areas: dict[int, int] = {}
        for digest in self._digests(self._states, False).tolist():
            self._areas.setdefault(digest, len(self._areas))
        self._area_value = found.numbers("area_value", len(self._areas) + 1)

    def values(self, states: list[list[float]]) -> list[float]:
        """Return the value of each state, interpolated between its cell and those beside it."""
        if not states:
            return []
        rows = np.array(states)
        own = [self._cells.get(d, -1) for d in self._digests(rows, True).tolist()]
        beside = [
            [self._cells.get(d, -1) for d in self._digests(rows, True, fluent, by).tolist()]
            for fluent in self._divided
            for by in (-1, 1)
        ]
        return [
            self._value_of_area(rows[k])
            if cell < 0
            else self._interpolated(rows[k], [cell, *(column[k] for column in beside)])
            for k, cell in enumerate(own)
        ]

    def set_value(self, state: list[float], value: float) -> None:
        """Set the value of the cell of a state, if it is there."""
        cell = self._cells.get(self._digests(np.array([state]), True).tolist()[0])
        if cell is not None:
            self._value[cell] = value

    def _interpolated(self, row: Rows, cells: list[int]) -> float:
        weights = total = 0.0
        known = [cell for cell in cells if cell >= 0]
        off = (row - self._states[known]) * np.maximum(0.0, self._scale)
        squares = off * off
        distances = squares[:, 0]
        for column in squares.T[1:]:
            distances = distances + column
        for cell, distance in zip(known, distances.tolist(), strict=True):
            weight = math.exp(-2.0 * distance) + 1e-9
            weights += weight
            total += weight * float(self._value[cell])
        return total / weights

    def _value_of_area(self, row: Rows) -> float:
        area = self._areas.get(self._digests(row[None], False).tolist()[0], -1)
        if area < 0:
            place = (row - self._low) * self._area
            if not ((place >= -MARGIN) & (place <= AREAS + MARGIN)).all():
                return float(self._value[-1])
        return float(self._area_value[area])

    def _digests(self, rows: Rows, exact: bool, moved: int = -1, by: int = 0) -> Digests:
        """Return the digest of the cell of each row, or of its area where not `exact`."""
        scale = self._scale if exact else self._area
        digests = np.full(len(rows), _START)
        for i in range(rows.shape[1]):
            if scale[i] > 0.0:
                place = np.floor((rows[:, i] - self._low[i]) * scale[i])
                number = np.clip(place, -_FAR, _FAR).astype(np.int64) + (by if i == moved else 0)
                digests = _mixed(digests, number.view(np.uint64))
            elif exact and scale[i] == 0.0:
                digests = _mixed(digests, (rows[:, i] + 0.0).view(np.uint64))
        return _mixed(digests ^ (digests >> np.uint64(32)), np.zeros(1, np.uint64))


def _mixed(digests: Digests, bits: Digests) -> Digests:
    digests = (digests ^ bits) * _FACTOR
    return digests ^ (digests >> np.uint64(29))
