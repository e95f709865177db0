"""The values of the cells of a graph, for compiled loops.

A cell holds the states whose continuous fluents lie in the same bins and whose other fluents are
equal. The values are one float64 array, so that a lookahead takes them as values at its leaves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

KIND, _ELSEWHERE, _REACH, _MASK, _SAMPLES, _NODES, _HEADER = range(7)
"""Header of the array: `CELLS`, the value of states that are not known, `Cells.reach`, table size
- 1, number of visited states S, and number of cells N; then low `[F]`, scale `[F]`, unit `[F]`,
rows of a visited state and the value of its cell `[S, F + 1]`, rows of the state of a cell and its
value `[N, F + 1]`, and the table, rows of digest + 1 and position of the cell."""
CELLS = -1.0
"""The first number of such an array; other value functions begin with a positive one."""
_FAR = 1e9
_SHORT = np.uint64(11)
"""Digests are stored as whole numbers of 53 bits, which are exact as float64."""


@cached_njit(nogil=True, forceinline=True)
def bin_of(number, low, scale):
    """Return the bin of a number."""
    place = np.floor((number - low) * scale)
    if not place > -_FAR:  # NaN as well
        return np.int64(-_FAR)
    return np.int64(min(place, _FAR))


@cached_njit(nogil=True, forceinline=True)
def _mixed(digest, bits):
    digest = (digest ^ bits) * np.uint64(0x9E3779B97F4A7C15)
    return digest ^ (digest >> np.uint64(29))


@cached_njit(nogil=True, forceinline=True)
def cell_of(row, low, scale, moved, by):
    """Return the digest of the cell of a state.

    Args:
        row: Pointer to the state, or array `[F]`.
        low: `[F]` lower ends of the ranges.
        scale: `[F]` bins per unit; 0 for a fluent that is not divided into bins.
        moved: Fluent whose bin is moved; -1 for none.
        by: Number of bins by which it is moved.
    """
    digest = np.uint64(0xCBF29CE484222325)
    for i in range(low.shape[0]):
        if scale[i] > 0.0:
            place = bin_of(row[i], low[i], scale[i])
            if i == moved:
                place += by
            digest = _mixed(digest, np.uint64(place))
        else:
            digest = _mixed(digest, np.float64(row[i] + 0.0).view(np.uint64))  # -0.0 equals 0.0
    digest ^= digest >> np.uint64(32)
    return _mixed(digest, np.uint64(0))


class Cells(NamedTuple):
    """A division of the state space into cells, and which part of it is known.

    Attributes:
        low: `[F]` lower ends of the ranges.
        scale: `[F]` bins per unit; 0 for a fluent whose values are told apart exactly.
        unit: `[F]` reciprocal of the ranges; 0 likewise.
        visited: Flat `[S * F]`, some visited states.
        reach: A state is known if it is as near as this to one of them: no fluent differs by more
            than this fraction of its range.
    """

    low: NDArray[np.float64]
    scale: NDArray[np.float64]
    unit: NDArray[np.float64]
    visited: NDArray[np.float64]
    reach: float


@cached_njit(nogil=True, forceinline=True)
def nearness(row, at, states, other, scale):
    """Return the weight of a state in an interpolation, by the distance in widths of cells."""
    total = 0.0
    for i in range(scale.shape[0]):
        off = (row[at + i] - states[other + i]) * scale[i]
        total += off * off
    return math.exp(-2.0 * total) + 1e-9


@cached_njit(nogil=True, forceinline=True)
def _found(packed, table, mask, digest):
    """Return the position of a cell; -1 if there is none."""
    key = np.float64(digest >> _SHORT) + 1.0
    slot = np.int64(digest & np.uint64(mask))
    while packed[table + 2 * slot] > 0.0:
        if packed[table + 2 * slot] == key:
            return np.int64(packed[table + 2 * slot + 1])
        slot = (slot + 1) & mask
    return np.int64(-1)


@cached_njit(nogil=True)
def pack(division, states, values, elsewhere):
    """Return the array of the values of cells.

    Args:
        division: Values of `Cells`.
        states: Flat `[N * F]`, a state in every cell.
        values: `[N]`.
        elsewhere: Value of states that are not known, also of visited ones that are in no cell.
    """
    cells = Cells(*division)
    nodes, size = values.shape[0], 2
    while size < 2 * nodes:
        size *= 2
    width = cells.low.shape[0]
    count = cells.visited.shape[0] // width
    samples = _HEADER + 3 * width
    rows = samples + count * (width + 1)
    table = rows + nodes * (width + 1)
    packed = np.zeros(table + 2 * size)
    packed[KIND], packed[_ELSEWHERE], packed[_REACH] = CELLS, elsewhere, cells.reach
    packed[_MASK], packed[_SAMPLES], packed[_NODES] = size - 1, count, nodes
    for i in range(width):
        packed[_HEADER + i], packed[_HEADER + width + i] = cells.low[i], cells.scale[i]
        packed[_HEADER + 2 * width + i] = cells.unit[i]
    for node in range(nodes):
        at = rows + node * (width + 1)
        row = states[node * width : (node + 1) * width]
        packed[at : at + width] = row
        packed[at + width] = values[node]
        digest = cell_of(row, cells.low, cells.scale, -1, 0)
        slot = np.int64(digest & np.uint64(size - 1))
        while packed[table + 2 * slot] > 0.0:
            slot = (slot + 1) & (size - 1)
        packed[table + 2 * slot] = np.float64(digest >> _SHORT) + 1.0
        packed[table + 2 * slot + 1] = node
    for k in range(count):
        at = samples + k * (width + 1)
        row = cells.visited[k * width : (k + 1) * width]
        packed[at : at + width] = row
        node = _found(packed, table, size - 1, cell_of(row, cells.low, cells.scale, -1, 0))
        packed[at + width] = values[node] if node >= 0 else elsewhere
    return packed


def repacked(packed: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return an array that was saved, made anew from what it says.

    Compiled code follows the positions in it. So none of these is taken over.

    Raises:
        ValueError: It is not an array that `pack` returned, for states of `width` numbers.
    """
    row, least = width + 1, _HEADER + 3 * width
    if packed.ndim != 1 or len(packed) < least or packed[KIND] != CELLS:
        raise ValueError("no values of cells")
    count, nodes = packed[_SAMPLES], packed[_NODES]
    if not (0 <= count <= len(packed) and 1 <= nodes <= len(packed)):
        raise ValueError(f"{count} visited states, {nodes} cells")
    rows = least + int(count) * row
    table = rows + int(nodes) * row
    if table > len(packed):
        raise ValueError(f"{len(packed)} numbers, at least {table} expected")
    low, scale, unit = packed[_HEADER:least].reshape(3, width).copy()
    visited, cells = packed[least:rows].reshape(-1, row), packed[rows:table].reshape(-1, row)
    division = Cells(low, scale, unit, visited[:, :-1].ravel(), float(packed[_REACH]))
    values = np.ascontiguousarray(cells[:, -1])
    made = pack(tuple(division), cells[:, :-1].ravel(), values, float(packed[_ELSEWHERE]))
    if not np.array_equal(made, packed):
        raise ValueError("a table that does not belong to the cells")
    found: NDArray[np.float64] = made
    return found


@cached_njit(nogil=True)
def cell_value_at(packed, states, at, width):
    """Return the value of a state, interpolated between its cell and those beside it.

    Where there are none, it is the value of the nearest visited state.

    Args:
        packed: See `pack`.
        states: Flat float64 array.
        at: Where the state begins in it.
        width: Fluents, F.
    """
    mask, count = np.int64(packed[_MASK]), int(packed[_SAMPLES])
    low, scale = packed[_HEADER : _HEADER + width], packed[_HEADER + width : _HEADER + 2 * width]
    samples = _HEADER + 3 * width
    rows = samples + count * (width + 1)
    table = rows + int(packed[_NODES]) * (width + 1)
    row = states[at : at + width]
    node = _found(packed, table, mask, cell_of(row, low, scale, -1, 0))
    if node >= 0:
        place = rows + node * (width + 1)
        weights = nearness(row, 0, packed, place, scale)
        total = weights * packed[place + width]
        for i in range(width):
            if scale[i] > 0.0:
                for by in (-1, 1):
                    node = _found(packed, table, mask, cell_of(row, low, scale, i, by))
                    if node >= 0:
                        place = rows + node * (width + 1)
                        weight = nearness(row, 0, packed, place, scale)
                        weights += weight
                        total += weight * packed[place + width]
        return total / weights
    nearest, value = packed[_REACH], packed[_ELSEWHERE]
    for k in range(count):
        sample, most = samples + k * (width + 1), 0.0
        for i in range(width):
            off = abs(states[at + i] - packed[sample + i]) * packed[_HEADER + 2 * width + i]
            most = max(most, off)
            if not most <= nearest:
                break
        if most <= nearest:
            nearest, value = most, packed[sample + width]
    return value
