"""The compiled outcomes of an action: what they predict, and how probable they are.

An outcome is what the file predicts for the action, what it predicts for another action with the
same arguments (a robot that slips; walls and conditions of the file hold then, too), or a change of
the state.

`buffer` is the memory of `serp.model.learned.parameter_buffer`, `table` that of
`serp.model.learned.outcome_table`, all as pointers. `room` is scratch memory, see `room_for`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE
from serp.model.learned import parameter_buffer as b
from serp.model.learned.parameter_buffer import flow
from serp.model.native import advanced

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

KINDS = 12
"""Most outcomes of an action that are distinguished; outcome 0 is the file's prediction."""
ROWS = 2048
"""Most rows of counts, one for each context; row 0 counts over all contexts."""
SLOTS = 8192
"""Slots of the hash table of contexts; a power of two."""
PRIORS = (0.1, 1.0, 10.0)
"""Samples that the counts over all contexts are worth, of the experts that count in a context."""
EXPERTS = 4
"""The last expert counts over all contexts alone."""
SETS = 64
"""Most sets of outcomes that explained an observation together; the rarest one makes room."""
_ITERATIONS = 10
"""Steps of expectation-maximisation after a sample; they go on from where the last ones ended."""

# Header of a table.
(
    T_COLUMNS, T_KINDS, T_ROWS, T_COUNT, T_CONTEXT, T_PLACES, T_SCHEMAS, T_CHANGES,
    T_CODES, T_SLOTS, T_COUNTS, T_TOTALS, T_EVIDENCE, T_TRUST, T_SETS,
    T_ALTERNATIVES, TABLE,
) = range(17)  # fmt: skip

_MEMORY = 0.995
"""Weight of the past in the evidence for an expert, per sample."""
MOST = 2_000.0
"""Counts of a context are halved beyond this total."""
LEAST = 1e-6
"""Probability that an observation is taken to have had at least, and least trust in an expert."""
_BASIS, _PRIME, _FOLD, _EXACT = (
    np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3), np.uint64(29), np.uint64(11),
)  # fmt: skip
"""Constants of the FNV-1a hash; the last one keeps the result below 2^53."""


@cached_njit(nogil=True, forceinline=True)
def _code(table, inputs, state):
    """Return a hash of the context of a state, a whole number below 2^53."""
    context, code = int(table[T_CONTEXT]), _BASIS
    for k in range(int(table[T_COUNT])):
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
def row_of(table, inputs, state):
    """Return the row of counts of a state's context; 0 for an unknown one."""
    return int(table[int(table[T_SLOTS]) + _find(table, _code(table, inputs, state))])


@cached_njit(nogil=True)
def enter(table, code, row):
    """Assign a row of counts to the code of a context."""
    slot = _find(table, code)
    table[int(table[T_CODES]) + row] = code
    table[int(table[T_SLOTS]) + slot] = row
    evidence = int(table[T_EVIDENCE]) + row * EXPERTS
    for e in range(EXPERTS):
        table[evidence + e] = 1.0


@cached_njit(nogil=True, forceinline=True)
def find_or_enter(table, inputs, state):
    """Return `row_of` a context, after adding a row for an unknown one while there is room."""
    code = _code(table, inputs, state)
    slot, rows = int(table[T_SLOTS]) + _find(table, code), int(table[T_ROWS])
    if table[slot] == 0.0 and rows < ROWS:
        enter(table, code, rows)
        table[T_ROWS] = rows + 1
    return int(table[slot])


@cached_njit(nogil=True, forceinline=True)
def fill_broadest(table, probabilities):
    """Compute the probability of each outcome over all contexts; the file's before any sample."""
    counts, total = int(table[T_COUNTS]), table[int(table[T_TOTALS])]
    for kind in range(int(table[T_KINDS])):
        probabilities[kind] = table[counts + kind] / total if total > 0.0 else 0.0
    if total <= 0.0:
        probabilities[0] = 1.0


@cached_njit(nogil=True, forceinline=True)
def refine(table, row, probabilities):
    """Turn the probabilities over all contexts into those of a row; row 0 has the same."""
    if row == 0:
        return
    trust, evidence = int(table[T_TRUST]), int(table[T_EVIDENCE]) + row * EXPERTS
    total = table[int(table[T_TOTALS]) + row]
    weights = table[trust + EXPERTS - 1] * table[evidence + EXPERTS - 1]
    counted, broader = 0.0, weights
    for e in range(len(PRIORS)):
        weight = table[trust + e] * table[evidence + e]
        weights += weight
        counted += weight / (total + PRIORS[e])
        broader += weight * PRIORS[e] / (total + PRIORS[e])
    counts = int(table[T_COUNTS]) + row * KINDS
    for kind in range(int(table[T_KINDS])):
        mixed = counted * table[counts + kind] + broader * probabilities[kind]
        probabilities[kind] = mixed / weights


@cached_njit(nogil=True, forceinline=True)
def fill_probabilities(table, inputs, state, probabilities):
    """Compute the probability of each outcome in a state, `[KINDS]`."""
    fill_broadest(table, probabilities)
    refine(table, row_of(table, inputs, state), probabilities)


@cached_njit(nogil=True)
def weigh_experts(table, row, probabilities, fits):
    """Update the evidence for the experts of a row by an observation.

    `probabilities` are those over all contexts. `fits` is 0 for an impossible outcome, and 2 for
    one that explains the observation.
    """
    if row == 0:
        return
    counts = int(table[T_COUNTS]) + row * KINDS
    trust, evidence = int(table[T_TRUST]), int(table[T_EVIDENCE]) + row * EXPERTS
    fitting, possible, told, known = 0.0, 0.0, 0.0, 0.0
    for kind in range(int(table[T_KINDS])):
        if fits[kind] != 0.0:
            possible += probabilities[kind]
            known += table[counts + kind]
            if fits[kind] == 2.0:
                fitting += probabilities[kind]
                told += table[counts + kind]
    if possible <= 0.0:
        return
    fitting, most, total = fitting / possible, 0.0, 0.0
    for e in range(EXPERTS):
        predicted = fitting
        if e < len(PRIORS):
            predicted = (told + PRIORS[e] * fitting) / (known + PRIORS[e])
        table[evidence + e] = table[evidence + e] ** _MEMORY * max(LEAST, predicted)
        most = max(most, table[evidence + e])
    for e in range(EXPERTS):
        table[evidence + e] = max(LEAST, table[evidence + e] / most)
        total += table[trust + e] * table[evidence + e]
    for e in range(EXPERTS):
        believed = table[trust + e] * table[evidence + e] / total
        table[trust + e] = max(LEAST, _MEMORY * table[trust + e] + believed)


@cached_njit(nogil=True, forceinline=True)
def _count_set(table, members):
    """Count an observation that a set of outcomes explains, given as the bits of a number."""
    sets, number = int(table[T_ALTERNATIVES]), int(table[T_SETS])
    place = number
    for k in range(number):
        if int(table[sets + 2 * k]) == members:
            place = k
    if place == number and number < SETS:
        table[T_SETS] = number + 1
    elif place == number:
        place = 0
        for k in range(number):
            if table[sets + 2 * k + 1] < table[sets + 2 * place + 1]:
                place = k
    if int(table[sets + 2 * place]) != members:
        table[sets + 2 * place], table[sets + 2 * place + 1] = members, 0.0
    table[sets + 2 * place + 1] += 1.0


@cached_njit(nogil=True, forceinline=True)
def share_sets(table, members, scratch):
    """Count an observation over all contexts, and divide all sets among their outcomes.

    The division is that of the greatest likelihood, by expectation-maximisation (Dempster, Laird &
    Rubin, Journal of the Royal Statistical Society B 39, 1977). `scratch` is `[KINDS]`.
    """
    _count_set(table, members)
    sets, number, kinds = int(table[T_ALTERNATIVES]), int(table[T_SETS]), int(table[T_KINDS])
    counts, totals = int(table[T_COUNTS]), int(table[T_TOTALS])
    half = 0.5 if table[totals] >= MOST else 1.0
    table[totals] = 0.0
    for k in range(number):
        table[sets + 2 * k + 1] *= half
        table[totals] += table[sets + 2 * k + 1]
    for _ in range(_ITERATIONS):
        for kind in range(kinds):
            scratch[kind] = 0.0
        for k in range(number):
            inside, size, within = int(table[sets + 2 * k]), 0, 0.0
            for kind in range(kinds):
                if inside >> kind & 1:
                    within += table[counts + kind]
                    size += 1
            for kind in range(kinds):
                if inside >> kind & 1:
                    share = table[counts + kind] / within if within > 0.0 else 1.0 / size
                    scratch[kind] += share * table[sets + 2 * k + 1]
        for kind in range(kinds):
            table[counts + kind] = scratch[kind]


@cached_njit(nogil=True, forceinline=True)
def add_share(table, row, kind, share):
    """Count a part of a sample; to follow an environment that drifts, many counts are halved."""
    counts, totals = int(table[T_COUNTS]) + row * KINDS, int(table[T_TOTALS]) + row
    table[counts + kind] += share
    table[totals] += share
    if table[totals] > MOST:
        for k in range(KINDS):
            table[counts + k] *= 0.5
        table[totals] *= 0.5


RARE = 1e-3
"""Less likely outcomes are left out of predictions."""
CHANGE = -1.0
"""In place of an action schema: the outcome is a change."""

# Positions in `room`, in multiples of KINDS, before a step `[F + 1]` and values `[KINDS, columns]`.
PROBABILITIES, SCRATCH, FIT, ENDS, STEP = range(5)


@cached_njit(nogil=True, forceinline=True)
def room_for(width):
    """Return the length of the scratch memory for states of `width` fluents."""
    return STEP * KINDS + width + 1 + KINDS * width


@cached_njit(nogil=True, forceinline=True)
def values_of(room, width, columns, kind):
    """Return a pointer to the counted fluents that an outcome predicts."""
    return advanced(room, STEP * KINDS + width + 1 + kind * columns)


@cached_njit(nogil=True, forceinline=True)
def table_of(buffer, group):
    """Return the offset of a group's outcome counts from the buffer; 0 where it has none."""
    return int(buffer[int(buffer[group + b.G_SHARED]) + b.S_OUTCOMES])


@cached_njit(nogil=True, forceinline=True)
def _by_schema(buffer, action, schema, table, inputs, state, dt, values, step):
    """Write the counted fluents as the file predicts for another action; return whether it does."""
    other = int(buffer[int(buffer[b.OTHERS]) + action * int(buffer[b.SCHEMAS]) + schema])
    if other < 0:
        return False
    if not flow(buffer, other, state, dt, step) & APPLICABLE:
        return False
    places = int(table[T_PLACES])
    for k in range(int(table[T_COLUMNS])):
        values[k] = step[int(inputs[int(table[places + k])])]
    return True


@cached_njit(nogil=True, forceinline=True)
def predict(buffer, action, table, kind, inputs, state, flowed, dt, room):
    """Write what an outcome predicts, see `values_of`; return whether it is possible.

    `flowed` `[F]` is the state after effects, processes and residual.
    """
    width, columns = int(buffer[b.WIDTH]), int(table[T_COLUMNS])
    values, places = values_of(room, width, columns, kind), int(table[T_PLACES])
    schema = table[int(table[T_SCHEMAS]) + kind]
    if kind == 0 or schema == CHANGE:
        changes = int(table[T_CHANGES]) + kind * columns
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            values[k] = flowed[column] if kind == 0 else state[column] + table[changes + k]
        return True
    step = advanced(room, STEP * KINDS)
    return _by_schema(buffer, action, int(schema), table, inputs, state, dt, values, step)


@cached_njit(nogil=True, forceinline=True)
def put(buffer, table, kind, inputs, room, out):
    """Set the counted fluents as an outcome predicts."""
    columns, places = int(table[T_COLUMNS]), int(table[T_PLACES])
    values = values_of(room, int(buffer[b.WIDTH]), columns, kind)
    for k in range(columns):
        out[int(inputs[int(table[places + k])])] = values[k]


@cached_njit(nogil=True, forceinline=True)
def alike(room, width, columns, kind, other):
    """Return whether two outcomes predict the same."""
    one, two = values_of(room, width, columns, kind), values_of(room, width, columns, other)
    different = 0
    for k in range(columns):
        different += one[k] != two[k]
    return different == 0


@cached_njit(nogil=True, forceinline=True)
def _merge(table, room, width, probabilities):
    """Give the probability of outcomes that predict the same to the first of them."""
    columns = int(table[T_COLUMNS])
    for kind in range(1, int(table[T_KINDS])):
        for other in range(kind):
            both = probabilities[kind] > 0.0 and probabilities[other] > 0.0
            if both and alike(room, width, columns, kind, other):
                probabilities[other] += probabilities[kind]
                probabilities[kind] = 0.0


@cached_njit(nogil=True)
def likeliest(buffer, action, group, state, flowed, dt, room):
    """Return the likeliest outcome of a group with counts.

    The first numbers of `room` become the probabilities of the outcomes, no two of which predict
    the same; `put` applies one.
    """
    table = advanced(buffer, table_of(buffer, group))
    inputs = advanced(buffer, int(buffer[group + b.G_INPUTS]))
    probabilities = room
    fill_probabilities(table, inputs, state, probabilities)
    kinds, left = int(table[T_KINDS]), 0.0
    for kind in range(kinds):
        usual = kind == 0 or probabilities[kind] >= RARE
        if not (usual and predict(buffer, action, table, kind, inputs, state, flowed, dt, room)):
            probabilities[kind] = 0.0
        left += probabilities[kind]
    if left <= RARE:
        probabilities[0] = left = 1.0
    _merge(table, room, int(buffer[b.WIDTH]), probabilities)
    best = 0
    for kind in range(kinds):
        probabilities[kind] /= left
        if probabilities[kind] > probabilities[best]:
            best = kind
    return best
