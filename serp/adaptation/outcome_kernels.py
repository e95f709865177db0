"""The compiled loops of outcome counts, the same for every domain.

A table is one float64 array, so that the compiled adapted step can read it by its address:
header, columns, context, changes, ranges, scores, codes, hash table of the rows, counts, totals.
"""

from __future__ import annotations

import math

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

KINDS = 12
"""Most outcomes of an action that are distinguished; outcome 0 is the file's prediction."""
ROWS = 1024
"""Most rows of counts, one for each context; row 0 counts over all contexts."""
SLOTS = 4096
"""Slots of the hash table of contexts; a power of two."""

# Header of a table.
(
    T_COLUMNS, T_KINDS, T_ROWS, T_COUNT, T_PREDICATES, T_CONTEXT, T_PLACES, T_CHANGES, T_CODES,
    T_SLOTS, T_COUNTS, T_TOTALS, T_RANGES, T_SCORES, TABLE,
) = range(15)  # fmt: skip
WEIGHTS = (0.1, 1.0, 10.0)
"""Weights, in samples, that a broader context may have as the prior of a narrower one (MacKay &
Peto, Natural Language Engineering 1, 1995); the one that has predicted best is used."""
_MEMORY = 0.995
"""Weight of the past in the scores of the weights, per sample."""
_LEAST = 1e-6
"""Probability that an outcome is taken to have had at least, in the scores."""
_BASIS, _PRIME, _FOLD, _EXACT = (
    np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3), np.uint64(29), np.uint64(11),
)  # fmt: skip
"""Constants of the FNV-1a hash; the last one keeps the result below 2^53."""


@cached_njit(nogil=True, forceinline=True)
def _code(table, inputs, state, count):
    """Return a hash of the first `count` values of a context, a whole number below 2^53."""
    context = int(table[T_CONTEXT])
    code = _BASIS ^ np.uint64(count)
    for k in range(count):
        value = np.int64(state[int(inputs[int(table[context + k])])])
        code = (code ^ np.uint64(value)) * _PRIME
        code ^= code >> _FOLD
    return float(code >> _EXACT)


@cached_njit(nogil=True, forceinline=True)
def _find(table, code):
    """Return the slot of a context's code: its own, or the free slot for it."""
    codes, slots = int(table[T_CODES]), int(table[T_SLOTS])
    slot = int(code) & (SLOTS - 1)
    row = int(table[slots + slot])
    while row != 0 and table[codes + row] != code:
        slot = (slot + 1) & (SLOTS - 1)
        row = int(table[slots + slot])
    return slot


@cached_njit(nogil=True, forceinline=True)
def _depth(table, narrow):
    """Return the number of values that define a context; 0 where it equals the broader one."""
    predicates, every = int(table[T_PREDICATES]), int(table[T_COUNT])
    if not narrow:
        return predicates
    return every if every > predicates else 0


@cached_njit(nogil=True, forceinline=True)
def row_of(table, inputs, state, narrow):
    """Return the row of counts of a context; 0 for an unknown one, or for the one of all states."""
    depth = _depth(table, narrow)
    if depth == 0:
        return 0
    slot = _find(table, _code(table, inputs, state, depth))
    return int(table[int(table[T_SLOTS]) + slot])


@cached_njit(nogil=True, forceinline=True)
def _best_weight(table):
    """Return the weight that has predicted best."""
    scores = int(table[T_SCORES])
    best = 0
    for k in range(1, len(WEIGHTS)):
        if table[scores + k] > table[scores + best]:
            best = k
    return WEIGHTS[best]


@cached_njit(nogil=True, forceinline=True)
def fill_probabilities(table, broad, narrow, weight, probabilities):
    """Compute the probability of each outcome, `[KINDS]`; there must be samples."""
    counts, totals = int(table[T_COUNTS]), int(table[T_TOTALS])
    total = table[totals]
    for kind in range(KINDS):
        probabilities[kind] = table[counts + kind] / total
    if broad:
        start, total = counts + broad * KINDS, table[totals + broad] + weight
        for kind in range(KINDS):
            probabilities[kind] = (table[start + kind] + weight * probabilities[kind]) / total
    if narrow:
        start, total = counts + narrow * KINDS, table[totals + narrow] + weight
        for kind in range(KINDS):
            probabilities[kind] = (table[start + kind] + weight * probabilities[kind]) / total


@cached_njit(nogil=True, forceinline=True)
def _within(table, kind, inputs, state):
    """Return whether an outcome leaves every counted fluent within its observed range."""
    columns, places = int(table[T_COLUMNS]), int(table[T_PLACES])
    changes, ranges = int(table[T_CHANGES]) + kind * columns, int(table[T_RANGES])
    for k in range(columns):
        value = state[int(inputs[int(table[places + k])])] + table[changes + k]
        if value < table[ranges + 2 * k] or value > table[ranges + 2 * k + 1]:
            return False
    return True


@cached_njit(nogil=True, forceinline=True)
def _extend(table, inputs, state):
    """Extend the observed ranges by a state."""
    columns, places, ranges = int(table[T_COLUMNS]), int(table[T_PLACES]), int(table[T_RANGES])
    for k in range(columns):
        value = state[int(inputs[int(table[places + k])])]
        table[ranges + 2 * k] = min(table[ranges + 2 * k], value)
        table[ranges + 2 * k + 1] = max(table[ranges + 2 * k + 1], value)


@cached_njit(nogil=True, forceinline=True)
def likeliest(table, inputs, state, probabilities):
    """Return the likeliest outcome in a state; write `probabilities`.

    An outcome that leads out of the range in which a fluent was observed has none.
    """
    broad = row_of(table, inputs, state, False)
    narrow = row_of(table, inputs, state, True)
    fill_probabilities(table, broad, narrow, _best_weight(table), probabilities)
    left = 1.0
    for kind in range(1, int(table[T_KINDS])):
        if not _within(table, kind, inputs, state):
            left -= probabilities[kind]
            probabilities[kind] = 0.0
    if left <= _LEAST:
        probabilities[0] = left = 1.0
    for kind in range(int(table[T_KINDS])):
        probabilities[kind] /= left
    best, most = 0, probabilities[0]
    for kind in range(1, int(table[T_KINDS])):
        if probabilities[kind] > most:
            best, most = kind, probabilities[kind]
    return best


@cached_njit(nogil=True, forceinline=True)
def apply_outcome(table, kind, inputs, state, out):
    """Set the counted fluents as an outcome other than the file's does."""
    places = int(table[T_PLACES])
    columns = int(table[T_COLUMNS])
    changes = int(table[T_CHANGES]) + kind * columns
    for k in range(columns):
        column = int(inputs[int(table[places + k])])
        out[column] = state[column] + table[changes + k]


@cached_njit(nogil=True, forceinline=True)
def restore_counted(table, inputs, before, out):
    """Set the counted fluents back to their values before any outcome."""
    places = int(table[T_PLACES])
    for k in range(int(table[T_COLUMNS])):
        column = int(inputs[int(table[places + k])])
        out[column] = before[column]


@cached_njit(nogil=True)
def count(table, inputs, state, written, observed, loss, rate, most):
    """Update the losses with a new sample, and then count it.

    `inputs` are the columns of the group in the `state` before, the one `written`, which the file
    predicts, and the one `observed`. `loss` `[2]` are moving averages of the Brier scores of the
    file and of the counts, `rate` the weight of this sample in them. Counts of a context are halved
    beyond `most`, to follow an environment that drifts.

    Returns:
        Whether the outcome is one of the distinguished ones.
    """
    columns, places = int(table[T_COLUMNS]), int(table[T_PLACES])
    changes, kinds = int(table[T_CHANGES]), int(table[T_KINDS])
    _extend(table, inputs, state)
    _extend(table, inputs, observed)
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
    if table[int(table[T_TOTALS])] > 0.0:
        probabilities = np.empty(KINDS)
        if kind >= 0:
            scores = int(table[T_SCORES])
            for k in range(len(WEIGHTS)):
                fill_probabilities(table, broad, narrow, WEIGHTS[k], probabilities)
                gained = math.log(max(_LEAST, probabilities[kind]))
                table[scores + k] = _MEMORY * table[scores + k] + gained
        fill_probabilities(table, broad, narrow, _best_weight(table), probabilities)
        for k in range(kinds):
            p = probabilities[k]
            score += p * p - (2.0 * p if k == kind else 0.0)
        loss[0] += rate * ((0.0 if kind == 0 else 2.0) - loss[0])
        loss[1] += rate * (score - loss[1])
    if kind < 0:
        if kinds == KINDS:
            return False
        kind = kinds
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            table[changes + kind * columns + k] = observed[column] - state[column]
        table[T_KINDS] = kinds + 1
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
    """Assign a row of counts to the code of a context."""
    slot = _find(table, code)
    table[int(table[T_CODES]) + row] = code
    table[int(table[T_SLOTS]) + slot] = row


@cached_njit(nogil=True)
def _row(table, inputs, state, narrow):
    """Return `row_of` a context, after adding a row for an unknown one while there is room."""
    depth = _depth(table, narrow)
    if depth == 0:
        return 0
    code = _code(table, inputs, state, depth)
    slot = _find(table, code)
    slots, rows = int(table[T_SLOTS]), int(table[T_ROWS])
    if table[slots + slot] == 0.0 and rows < ROWS:
        enter(table, code, rows)
        table[T_ROWS] = rows + 1
    return int(table[slots + slot])


@cached_njit(nogil=True)
def _add(table, row, kind, most):
    counts, totals = int(table[T_COUNTS]) + row * KINDS, int(table[T_TOTALS]) + row
    table[counts + kind] += 1.0
    table[totals] += 1.0
    if table[totals] > most:
        for k in range(KINDS):
            table[counts + k] *= 0.5
        table[totals] *= 0.5
