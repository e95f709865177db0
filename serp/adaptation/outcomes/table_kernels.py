"""The compiled table of outcome counts, the same for every domain: contexts and probabilities.

A table is one float64 array, so that the compiled adapted step can read it by its address.

The probabilities of a context are a mixture of experts: "as in the broader context", and its own
counts with the broader context as a prior of some samples (MacKay & Peto, Natural Language
Engineering 1, 1995). Each context weighs the experts by how well they have predicted its samples;
what they are weighed by before is learned from all contexts. So a context is told apart where the
evidence says so, as in context-tree weighting (Willems, Shtarkov & Tjalkens, IEEE Transactions on
Information Theory 41, 1995).
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

KINDS = 12
"""Most outcomes of an action that are distinguished; outcome 0 is the file's prediction."""
ROWS = 2048
"""Most rows of counts, one for each context; row 0 counts over all contexts."""
SLOTS = 8192
"""Slots of the hash table of contexts; a power of two."""
PRIORS = (0.1, 1.0, 10.0)
"""Samples that the broader context is worth, of the experts that count."""
EXPERTS = 4
"""The last expert is the broader context."""

BY_PREDICATES, BY_NUMBERS, BY_BOTH = range(3)
"""What defines a context: predicates, whole numbers, or both; the first two are broader."""
LEVELS = 3
SETS = 64
"""Most sets of outcomes that explained an observation together; the rarest one makes room."""
_ITERATIONS = 10
"""Steps of expectation-maximisation after a sample; they go on from where the last ones ended."""

# Header of a table.
(
    T_COLUMNS, T_KINDS, T_ROWS, T_COUNT, T_PREDICATES, T_CONTEXT, T_PLACES, T_SCHEMAS, T_CHANGES,
    T_CODES, T_SLOTS, T_COUNTS, T_TOTALS, T_RANGES, T_EVIDENCE, T_TRUST, T_PATHS, T_SETS,
    T_ALTERNATIVES, TABLE,
) = range(20)  # fmt: skip

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
def _code(table, inputs, state, level):
    """Return a hash of a context, a whole number below 2^53; -1 where a broader one is the same."""
    first, last = 0, int(table[T_COUNT])
    predicates = int(table[T_PREDICATES])
    if level == BY_PREDICATES:
        last = predicates
    elif level == BY_NUMBERS:
        first = predicates
    elif predicates in (0, last):
        return -1.0
    if first == last:
        return -1.0
    context = int(table[T_CONTEXT])
    code = _BASIS ^ np.uint64(level)
    for k in range(first, last):
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
def row_of(table, inputs, state, level):
    """Return the row of counts of a context; 0 for an unknown one, or one like a broader one."""
    code = _code(table, inputs, state, level)
    if code < 0.0:
        return 0
    return int(table[int(table[T_SLOTS]) + _find(table, code)])


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
def find_or_enter(table, inputs, state, level):
    """Return `row_of` a context, after adding a row for an unknown one while there is room."""
    code = _code(table, inputs, state, level)
    if code < 0.0:
        return 0
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
def refine(table, level, row, probabilities):
    """Turn the probabilities of a broader context into those of a row; row 0 has the same."""
    if row == 0:
        return
    trust, evidence = int(table[T_TRUST]) + level * EXPERTS, int(table[T_EVIDENCE]) + row * EXPERTS
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
def mix_paths(table, probabilities, others):
    """Mix what predicates say with what numbers say, into the first argument."""
    paths = int(table[T_PATHS])
    share = table[paths] / (table[paths] + table[paths + 1])
    for kind in range(int(table[T_KINDS])):
        probabilities[kind] = share * probabilities[kind] + (1.0 - share) * others[kind]


@cached_njit(nogil=True, forceinline=True)
def fill_probabilities(table, inputs, state, probabilities, scratch):
    """Compute the probability of each outcome in a state; both arrays are `[KINDS]`."""
    fill_broadest(table, probabilities)
    fill_broadest(table, scratch)
    refine(table, BY_PREDICATES, row_of(table, inputs, state, BY_PREDICATES), probabilities)
    refine(table, BY_NUMBERS, row_of(table, inputs, state, BY_NUMBERS), scratch)
    mix_paths(table, probabilities, scratch)
    refine(table, BY_BOTH, row_of(table, inputs, state, BY_BOTH), probabilities)


@cached_njit(nogil=True, forceinline=True)
def share_of(table, probabilities, fits):
    """Return the probability of the outcomes that fit, 2 in `fits`, among the possible, not 0."""
    fitting, possible = 0.0, 0.0
    for kind in range(int(table[T_KINDS])):
        if fits[kind] != 0.0:
            possible += probabilities[kind]
            if fits[kind] == 2.0:
                fitting += probabilities[kind]
    return max(LEAST, fitting / possible) if possible > 0.0 else 1.0


@cached_njit(nogil=True)
def weigh_experts(table, level, row, probabilities, fits):
    """Update the evidence for the experts of a row by an observation, see `share_of`.

    `probabilities` are those of the broader context.
    """
    if row == 0:
        return
    counts = int(table[T_COUNTS]) + row * KINDS
    trust, evidence = int(table[T_TRUST]) + level * EXPERTS, int(table[T_EVIDENCE]) + row * EXPERTS
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
def weigh_paths(table, by_predicates, by_numbers):
    """Update the evidence for two ways of predicting by the probabilities that they had given."""
    paths = int(table[T_PATHS])
    first = table[paths] ** _MEMORY * by_predicates
    second = table[paths + 1] ** _MEMORY * by_numbers
    most = max(first, second)
    table[paths], table[paths + 1] = max(LEAST, first / most), max(LEAST, second / most)


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
