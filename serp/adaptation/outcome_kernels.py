"""The compiled loops of counted outcomes, the same for every domain.

A table is one array of float64, so that the compiled corrected step can read it by its address:
header, columns, changes, hash table, counts. `at` below are offsets into it.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

KINDS = 12
"""Outcomes of an action that are told apart, at most: what the file says, and eleven others."""
ROWS = 1024
"""Contexts that counts are kept for, at most; the first one is all contexts together."""
SLOTS = 4096
"""Of the hash table of contexts; a power of two."""

# Header of a table.
(
    T_COLUMNS, T_KINDS, T_ROWS, T_COUNT, T_PREDICATES, T_CONTEXT, T_PLACES, T_CHANGES, T_CODES,
    T_SLOTS, T_COUNTS, T_TOTALS, TABLE,
) = range(13)  # fmt: skip
_T_KINDS, _T_ROWS, _T_COLUMNS, _T_COUNT = T_KINDS, T_ROWS, T_COLUMNS, T_COUNT
_T_PREDICATES, _T_CONTEXT, _T_PLACES = T_PREDICATES, T_CONTEXT, T_PLACES
_T_CHANGES, _T_CODES, _T_SLOTS = T_CHANGES, T_CODES, T_SLOTS
_T_COUNTS, _T_TOTALS = T_COUNTS, T_TOTALS
_KINDS, _ROWS, _SLOTS = KINDS, ROWS, SLOTS

_BROAD = 3.0
"""So many samples weighs what is known of all contexts, in one where the same predicates hold."""
_NARROW = 10.0
"""So many samples weighs that, in one where all whole numbers are the same too."""
_BASIS, _PRIME, _FOLD, _EXACT = (
    np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3), np.uint64(29), np.uint64(11),
)  # fmt: skip


@cached_njit(nogil=True, forceinline=True)
def _code(table, inputs, state, count):
    """Return a hash of the first `count` values of a context (FNV-1a), a whole number < 2^53."""
    context = int(table[_T_CONTEXT])
    code = _BASIS ^ np.uint64(count)
    for k in range(count):
        value = np.int64(state[int(inputs[int(table[context + k])])])
        code = (code ^ np.uint64(value)) * _PRIME
        code ^= code >> _FOLD
    return float(code >> _EXACT)


@cached_njit(nogil=True, forceinline=True)
def _find(table, code):
    """Return the slot of a context's code: its own, or the free one where it would be put."""
    codes, slots = int(table[_T_CODES]), int(table[_T_SLOTS])
    slot = int(code) & (_SLOTS - 1)
    while table[slots + slot] != 0.0 and table[codes + slot] != code:
        slot = (slot + 1) & (_SLOTS - 1)
    return slot


@cached_njit(nogil=True, forceinline=True)
def _depth(table, narrow):
    """Return how many values make a context; 0 where it is no other than the broader one."""
    predicates, every = int(table[_T_PREDICATES]), int(table[_T_COUNT])
    if not narrow:
        return predicates
    return every if every > predicates else 0


@cached_njit(nogil=True, forceinline=True)
def row_of(table, inputs, state, narrow):
    """Return the row of counts of a context; 0 where it was never seen, or is all there is."""
    depth = _depth(table, narrow)
    if depth == 0:
        return 0
    slot = _find(table, _code(table, inputs, state, depth))
    return int(table[int(table[_T_SLOTS]) + slot])


@cached_njit(nogil=True, forceinline=True)
def fill_shares(table, broad, narrow, shares):
    """Fill `[KINDS]` how likely each outcome is; a context counts more, the more samples it has.

    There are samples. What is not told apart yet gets 0.
    """
    counts, totals = int(table[_T_COUNTS]), int(table[_T_TOTALS])
    total = table[totals]
    for kind in range(_KINDS):
        shares[kind] = table[counts + kind] / total
    if broad:
        start, total = counts + broad * _KINDS, table[totals + broad] + _BROAD
        for kind in range(_KINDS):
            shares[kind] = (table[start + kind] + _BROAD * shares[kind]) / total
    if narrow:
        start, total = counts + narrow * _KINDS, table[totals + narrow] + _NARROW
        for kind in range(_KINDS):
            shares[kind] = (table[start + kind] + _NARROW * shares[kind]) / total


@cached_njit(nogil=True, forceinline=True)
def likeliest(table, inputs, state, shares):
    """Return the most likely outcome in a state, filling `shares`; 0: what the file says."""
    broad = row_of(table, inputs, state, False)
    narrow = row_of(table, inputs, state, True)
    fill_shares(table, broad, narrow, shares)
    best, most = 0, shares[0]
    for kind in range(1, int(table[_T_KINDS])):
        if shares[kind] > most:
            best, most = kind, shares[kind]
    return best


@cached_njit(nogil=True, forceinline=True)
def put(table, kind, inputs, state, out):
    """Let an outcome other than what the file says come about."""
    places = int(table[_T_PLACES])
    columns = int(table[_T_COLUMNS])
    changes = int(table[_T_CHANGES]) + kind * columns
    for k in range(columns):
        column = int(inputs[int(table[places + k])])
        out[column] = state[column] + table[changes + k]


@cached_njit(nogil=True, forceinline=True)
def take_back(table, inputs, before, out):
    """Give what is counted the values again that it had before any outcome."""
    places = int(table[_T_PLACES])
    for k in range(int(table[_T_COLUMNS])):
        column = int(inputs[int(table[places + k])])
        out[column] = before[column]


@cached_njit(nogil=True)
def count(table, inputs, state, written, observed, loss, rate, most):
    """Take a sample into account, its loss first: it is of data not seen before.

    Args:
        table: A table, as an array.
        inputs: `[d]` columns of the view.
        state: `[F]`.
        written: `[F]` what the file makes of it.
        observed: `[F]`.
        loss: `[2]` decayed Brier scores of the file and of the counts.
        rate: Weight of this sample in these.
        most: Counts of a context are halved beyond that, so that a world that drifts is followed.

    Returns:
        Whether the outcome is one of those that are told apart.
    """
    columns, places = int(table[_T_COLUMNS]), int(table[_T_PLACES])
    changes, kinds = int(table[_T_CHANGES]), int(table[_T_KINDS])
    kind = 0
    for k in range(columns):
        column = int(inputs[int(table[places + k])])
        if observed[column] != written[column]:
            kind = -1
    if kind < 0:
        for candidate in range(1, kinds):
            same = True
            for k in range(columns):
                column = int(inputs[int(table[places + k])])
                change = observed[column] - state[column]
                same = same and table[changes + candidate * columns + k] == change
            if same:
                kind = candidate
                break
    broad = row_of(table, inputs, state, False)
    narrow = row_of(table, inputs, state, True)
    score = 1.0
    if table[int(table[_T_TOTALS])] > 0.0:
        shares = np.empty(_KINDS)
        fill_shares(table, broad, narrow, shares)
        for k in range(kinds):
            p = shares[k]
            score += p * p - (2.0 * p if k == kind else 0.0)
        loss[0] += rate * ((0.0 if kind == 0 else 2.0) - loss[0])
        loss[1] += rate * (score - loss[1])
    if kind < 0:
        if kinds == _KINDS:
            return False
        kind = kinds
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            table[changes + kind * columns + k] = observed[column] - state[column]
        table[_T_KINDS] = kinds + 1
    broad = _row(table, inputs, state, False)
    narrow = _row(table, inputs, state, True)
    _add(table, 0, kind, most)
    if broad:
        _add(table, broad, kind, most)
    if narrow:
        _add(table, narrow, kind, most)
    return True


@cached_njit(nogil=True)
def enter(table, code, row):
    """Give a context, by its code, a row of counts."""
    slot = _find(table, code)
    table[int(table[_T_CODES]) + slot] = code
    table[int(table[_T_SLOTS]) + slot] = row


@cached_njit(nogil=True)
def _row(table, inputs, state, narrow):
    """As `row_of`, but a context that was never seen gets a row while there is room."""
    depth = _depth(table, narrow)
    if depth == 0:
        return 0
    code = _code(table, inputs, state, depth)
    slot = _find(table, code)
    slots, rows = int(table[_T_SLOTS]), int(table[_T_ROWS])
    if table[slots + slot] == 0.0 and rows < _ROWS:
        enter(table, code, rows)
        table[_T_ROWS] = rows + 1
    return int(table[slots + slot])


@cached_njit(nogil=True)
def _add(table, row, kind, most):
    counts, totals = int(table[_T_COUNTS]) + row * _KINDS, int(table[_T_TOTALS]) + row
    table[counts + kind] += 1.0
    table[totals] += 1.0
    if table[totals] > most:
        for k in range(_KINDS):
            table[counts + k] *= 0.5
        table[totals] *= 0.5
