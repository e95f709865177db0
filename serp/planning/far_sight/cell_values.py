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

KIND, _ELSEWHERE, _MASK, _AREA_MASK, _NODES, _HEADER = range(6)
"""Header of the array: `CELLS`, the value of states that are not known, sizes of both tables - 1,
and number of cells N; then low `[F]`, scale `[F]`, area `[F]`, rows of the state of a cell and its
value `[N, F + 1]`, the table of the cells, rows of digest + 1 and position, and the table of the
areas, rows of digest + 1, sum of the values of cells in it, and their number."""
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

    Areas are larger than cells, and divide continuous fluents only. A state is known if something
    in its area was visited, or in an area beside it.

    Attributes:
        low: `[F]` lower ends of the ranges.
        scale: `[F]` bins per unit; 0 for a fluent whose values are told apart exactly.
        area: `[F]` bins of an area per unit; 0 likewise.
        known: Hash table of the digests of the areas that were visited; 0 for an empty slot.
    """

    low: NDArray[np.float64]
    scale: NDArray[np.float64]
    area: NDArray[np.float64]
    known: NDArray[np.uint64]


@cached_njit(nogil=True, forceinline=True)
def area_of(row, low, area, moved, by):
    """Return the digest of the area of a state, never 0; arguments as those of `cell_of`."""
    digest = np.uint64(0xCBF29CE484222325)
    for i in range(low.shape[0]):
        if area[i] > 0.0:
            place = bin_of(row[i], low[i], area[i])
            if i == moved:
                place += by
            digest = _mixed(digest, np.uint64(place))
    digest ^= digest >> np.uint64(32)
    return _mixed(digest, np.uint64(0)) | np.uint64(1)


@cached_njit(nogil=True, forceinline=True)
def _is_marked(known, digest):
    mask = known.shape[0] - 1
    slot = np.int64(digest & np.uint64(mask))
    while known[slot] != 0 and known[slot] != digest:
        slot = (slot + 1) & mask
    return known[slot] == digest, slot


@cached_njit(nogil=True)
def areas_of(states, low, area):
    """Return the hash table of the areas of states `[N, F]`."""
    size = 2
    while size < 2 * states.shape[0]:
        size *= 2
    known = np.zeros(size, dtype=np.uint64)
    for k in range(states.shape[0]):
        digest = area_of(states[k], low, area, -1, 0)
        marked, slot = _is_marked(known, digest)
        if not marked:
            known[slot] = digest
    return known


@cached_njit(nogil=True, forceinline=True)
def is_known(cells, row, width):
    """Return whether a state is known; `row` is a pointer to it."""
    if _is_marked(cells.known, area_of(row, cells.low, cells.area, -1, 0))[0]:
        return True
    for k in range(2 * width):
        if cells.area[k // 2] > 0.0:
            digest = area_of(row, cells.low, cells.area, k // 2, 1 - 2 * (k % 2))
            if _is_marked(cells.known, digest)[0]:
                return True
    return False


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


@cached_njit(nogil=True, forceinline=True)
def _area_in(packed, table, mask, digest):
    """Return where the entry of an area begins, or an empty entry for it."""
    key = np.float64(digest >> _SHORT) + 1.0
    slot = np.int64(digest & np.uint64(mask))
    while packed[table + 3 * slot] > 0.0 and packed[table + 3 * slot] != key:
        slot = (slot + 1) & mask
    return table + 3 * slot


@cached_njit(nogil=True)
def pack(division, states, values, elsewhere):
    """Return the array of the values of cells.

    Args:
        division: `Cells.low`, `scale` and `area`.
        states: Flat `[N * F]`, a state in every cell.
        values: `[N]`.
        elsewhere: Value of states that are not known.
    """
    low, scale, area = division
    nodes, size = values.shape[0], 2
    while size < 2 * nodes:
        size *= 2
    width = low.shape[0]
    rows = _HEADER + 3 * width
    table = rows + nodes * (width + 1)
    areas = table + 2 * size
    packed = np.zeros(areas + 3 * size)
    packed[KIND], packed[_ELSEWHERE], packed[_NODES] = CELLS, elsewhere, nodes
    packed[_MASK], packed[_AREA_MASK] = size - 1, size - 1
    for i in range(width):
        packed[_HEADER + i], packed[_HEADER + width + i] = low[i], scale[i]
        packed[_HEADER + 2 * width + i] = area[i]
    for node in range(nodes):
        at = rows + node * (width + 1)
        row = states[node * width : (node + 1) * width]
        packed[at : at + width] = row
        packed[at + width] = values[node]
        digest = cell_of(row, low, scale, -1, 0)
        slot = np.int64(digest & np.uint64(size - 1))
        while packed[table + 2 * slot] > 0.0:
            slot = (slot + 1) & (size - 1)
        packed[table + 2 * slot] = np.float64(digest >> _SHORT) + 1.0
        packed[table + 2 * slot + 1] = node
        digest = area_of(row, low, area, -1, 0)
        entry = _area_in(packed, areas, size - 1, digest)
        packed[entry] = np.float64(digest >> _SHORT) + 1.0
        packed[entry + 1] += values[node]
        packed[entry + 2] += 1.0
    return packed


def repacked(packed: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return an array that was saved, made anew from what it says.

    Compiled code follows the positions in it. So none of these is taken over.

    Raises:
        ValueError: It is not an array that `pack` returned, for states of `width` numbers.
    """
    least = _HEADER + 3 * width
    if packed.ndim != 1 or len(packed) < least or packed[KIND] != CELLS:
        raise ValueError("no values of cells")
    nodes = packed[_NODES]
    if not 1 <= nodes * (width + 1) <= len(packed) - least:
        raise ValueError(f"{len(packed)} numbers for {nodes:g} cells")
    low, scale, area = packed[_HEADER:least].reshape(3, width).copy()
    cells = packed[least : least + int(nodes) * (width + 1)].reshape(-1, width + 1)
    values = np.ascontiguousarray(cells[:, -1])
    found: NDArray[np.float64] = pack(
        (low, scale, area), cells[:, :-1].ravel(), values, float(packed[_ELSEWHERE])
    )
    if not np.array_equal(found, packed):
        raise ValueError("tables that do not belong to the cells")
    return found


@cached_njit(nogil=True)
def cell_value_at(packed, states, at, width):
    """Return the value of a state, interpolated between its cell and those beside it.

    Where its cell is not there, it is the mean of the cells in its area.

    Args:
        packed: See `pack`.
        states: Flat float64 array.
        at: Where the state begins in it.
        width: Fluents, F.
    """
    mask = np.int64(packed[_MASK])
    low, scale = packed[_HEADER : _HEADER + width], packed[_HEADER + width : _HEADER + 2 * width]
    rows = _HEADER + 3 * width
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
    area, areas = packed[_HEADER + 2 * width : rows], table + 2 * (mask + 1)
    digest = area_of(row, low, area, -1, 0)
    entry = _area_in(packed, areas, np.int64(packed[_AREA_MASK]), digest)
    if packed[entry] > 0.0:
        return packed[entry + 1] / packed[entry + 2]
    return packed[_ELSEWHERE]
