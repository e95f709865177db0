"""Cells of the state space, and their values, for compiled loops.

A cell holds the states whose continuous fluents lie in the same bins and whose other fluents are
equal. Records are passed as plain tuples, see `serp.planning.edges`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.planning.hash_table import START, bits_of, distinct, finished, key_slot, mixed

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

Floats = NDArray[np.float64]

AREAS = 8.0
"""Areas in the range of a fluent, see `Cells`."""
MARGIN = 2.0
"""Areas on either side of it that a graph may enter: the state space may have no end."""
_FAR = 1e9


class Cells(NamedTuple):
    """A division of the state space into cells.

    Attributes:
        low: `[F]` lower ends of the ranges of what was visited.
        scale: `[F]` bins per unit; 0 for a fluent whose values are told apart exactly, negative for
            one on which nothing depends.
        area: `[F]` bins per unit of areas, which are larger than cells and divide continuous
            fluents only; 0 likewise.
    """

    low: Floats
    scale: Floats
    area: Floats


class CellValues(NamedTuple):
    """The values of N cells.

    Attributes:
        low, scale, area: As in `Cells`.
        states: Flat `[N * F]`, a state in every cell.
        value: `[N + 1]` of the cells, then of states that are not known; empty without any cells.
        table, digest: Hash table of the cells, and their digests.
        area_table, area_digest, area_value: The same of the A areas that they lie in, and `[A + 1]`
            the least value in each, then of all, when the cells were found.
    """

    low: Floats
    scale: Floats
    area: Floats
    states: Floats
    value: Floats
    table: NDArray[np.int32]
    digest: NDArray[np.uint64]
    area_table: NDArray[np.int32]
    area_digest: NDArray[np.uint64]
    area_value: Floats

    @classmethod
    def of(
        cls, low: Floats, scale: Floats, area: Floats, states: Floats, value: Floats
    ) -> CellValues:
        """Return the record whose first columns these are.

        Raises:
            ValueError: Their lengths do not fit together, or two states lie in one cell.
        """
        cells, width = max(0, len(value) - 1), len(low)
        if states.shape != (cells * width,) or len(scale) != width or len(area) != width:
            raise ValueError(f"{len(states)} numbers for {cells} cells")
        table, digest, _ = distinct(_digests(states, low, scale, True))
        area_table, area_digest, place = distinct(_digests(states, low, area, False))
        if len(digest) != cells:
            raise ValueError("two states in one cell")
        least = np.full(len(area_digest) + 1, np.inf)
        np.minimum.at(least, place, value[:cells])
        least[-1] = value[:cells].min() if cells else 0.0
        return cls(low, scale, area, states, value, table, digest, area_table, area_digest, least)

    def state_dict(self) -> Arrays:
        """Return arrays that `restored` takes."""
        return {name: getattr(self, name).copy() for name in _SAVED}

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]], width: int) -> CellValues:
        """Return what `state_dict` was taken from; a state has `width` numbers.

        What compiled code follows is made anew from them.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("values of cells", arrays, {})
        *columns, least = (saved.array(name, np.float64, (-1,)).copy() for name in _SAVED)
        if not len(columns[-1]):
            return NO_CELLS
        if len(columns[0]) != width:
            raise saved.wrong(f"low has {len(columns[0])} numbers for {width} fluents")
        try:
            made = cls.of(*columns)
        except ValueError as error:
            raise saved.wrong(str(error)) from None
        if least.shape != made.area_value.shape:
            raise saved.wrong(f"area_value has {len(least)} numbers, not {len(made.area_value)}")
        return made._replace(area_value=least)


_SAVED = (*CellValues._fields[:5], "area_value")
"""The others follow from these; values of areas are those of when the cells were found."""


@cached_njit(nogil=True, forceinline=True)
def digest_of(row, low, scale, exact, moved, by):
    """Return the digest of the cell of a state, a pointer or an array `[F]`, or of its area.

    Args:
        row: The state.
        low: As in `Cells`.
        scale: As in `Cells`, or `area`.
        exact: Whether the values of fluents that are not divided count; in areas they do not.
        moved: Fluent whose bin is moved; -1 for none.
        by: Number of bins by which it is moved.
    """
    digest = np.uint64(START)
    for i in range(low.shape[0]):
        if scale[i] > 0.0:
            place = np.floor((row[i] - low[i]) * scale[i])
            number = np.int64(min(place, _FAR)) if place > -_FAR else np.int64(-_FAR)  # NaN as well
            if i == moved:
                number += by
            digest = mixed(digest, np.uint64(number))
        elif exact and scale[i] == 0.0:
            digest = mixed(digest, bits_of(row[i]))
    return finished(digest)


@cached_njit(nogil=True)
def _digests(states, low, scale, exact):
    """Return the digests `[N]` of states, flat `[N * F]`."""
    width = low.shape[0]
    digests = np.empty(states.shape[0] // max(1, width), dtype=np.uint64)
    for k in range(digests.shape[0]):
        digests[k] = digest_of(states[k * width : (k + 1) * width], low, scale, exact, -1, 0)
    return digests


@cached_njit(nogil=True, forceinline=True)
def in_range(cells, row, width):
    """Return whether a state is close to the range of what was visited; `row` points to it."""
    for i in range(width):
        place = (row[i] - cells.low[i]) * cells.area[i]
        if not -MARGIN <= place <= AREAS + MARGIN:
            return False
    return True


@cached_njit(nogil=True, forceinline=True)
def nearness(row, at, states, other, scale):
    """Return the weight of a state in an interpolation, by the distance in widths of cells."""
    total = 0.0
    for i in range(scale.shape[0]):
        off = (row[at + i] - states[other + i]) * max(0.0, scale[i])
        total += off * off
    return math.exp(-2.0 * total) + 1e-9


@cached_njit(nogil=True)
def value_at(values, states, at):
    """Return the value of a state, interpolated between its cell and those beside it.

    Where its cell is not there, it is the least of those in its area, or of all: a plan looks for
    the best of many states, and would find the one of which the least is known. The state begins
    at a position of a flat array.
    """
    low, scale, width = values.low, values.scale, values.low.shape[0]
    row = states[at : at + width]
    weights = total = 0.0
    for k in range(-1, 2 * width):
        if k < 0 or scale[k // 2] > 0.0:
            moved = k // 2 if k >= 0 else -1
            digest = digest_of(row, low, scale, True, moved, 2 * (k % 2) - 1)
            cell = values.table[key_slot(values.table, values.digest, digest)]
            if cell >= 0:
                weight = nearness(row, 0, values.states, cell * width, scale)
                weights += weight
                total += weight * values.value[cell]
            elif k < 0:
                break
    if weights > 0.0:
        return total / weights
    digest = digest_of(row, low, values.area, False, -1, 0)
    area = values.area_table[key_slot(values.area_table, values.area_digest, digest)]
    if area < 0 and not in_range(values, row, width):
        return values.value[values.value.shape[0] - 1]
    return values.area_value[area]  # -1: the last one


@cached_njit(nogil=True)
def set_value(values, state, value):
    """Set the value of the cell of a state `[F]`, if it is there."""
    digest = digest_of(state, values.low, values.scale, True, -1, 0)
    cell = values.table[key_slot(values.table, values.digest, digest)]
    if cell >= 0:
        values.value[cell] = value


_NONE: Final = np.zeros(0)
_TABLE: Final = np.full(2, -1, dtype=np.int32), np.zeros(0, dtype=np.uint64)
NO_CELLS: Final = CellValues(_NONE, _NONE, _NONE, _NONE, _NONE, *_TABLE, *_TABLE, np.zeros(1))
"""No values."""
