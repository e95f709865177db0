"""The compiled counting of outcomes.

Several outcomes may explain one observation, at a wall for example: the sample is divided among
them. Over all contexts this is repeated for all samples, by the sets of outcomes that explained
them, so that it does not matter which came first; a context keeps the division by the probabilities
of that time (online expectation-maximisation: Cappé & Moulines, Journal of the Royal Statistical
Society B 71, 2009). Names are those of `serp.adaptation.outcomes.prediction_kernels`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.file_step import settle
from serp.adaptation.outcomes import table_kernels as c
from serp.adaptation.outcomes.prediction_kernels import (
    CHANGE,
    ENDS,
    FIT,
    SCRATCH,
    STEP,
    alike,
    predict,
    put,
    room_for,
)  # fmt: skip
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import advanced, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

IMPOSSIBLE, POSSIBLE, FITS = range(3)
"""How an outcome fits an observation; one without a prediction is impossible."""


@cached_njit(nogil=True, forceinline=True)
def _extend(table, inputs, state):
    """Extend the observed ranges by a state."""
    columns, places, ranges = (
        int(table[c.T_COLUMNS]),
        int(table[c.T_PLACES]),
        int(table[c.T_RANGES]),
    )
    for k in range(columns):
        value = state[int(inputs[int(table[places + k])])]
        table[ranges + 2 * k] = min(table[ranges + 2 * k], value)
        table[ranges + 2 * k + 1] = max(table[ranges + 2 * k + 1], value)


@cached_njit(nogil=True)
def _compare(buffer, table, kind, inputs, state, flow, observed, dt, room):
    """Return whether an outcome, after events, is the one observed; and whether it is an end.

    `flow` is the state `[F + 1]` after effects and processes, and the flags so far.
    """
    width = int(buffer[b.WIDTH])
    flowed, flags = flow
    out = advanced(room, STEP * c.KINDS)
    for i in range(width + 1):
        out[i] = flowed[i]
    put(buffer, table, kind, inputs, room, out)
    settled = settle(buffer, state, flags, dt, out)
    if not settled & APPLICABLE:
        return False, False
    places = int(table[c.T_PLACES])
    for k in range(int(table[c.T_COLUMNS])):
        column = int(inputs[int(table[places + k])])
        if out[column] != observed[column]:
            return False, settled & TERMINAL != 0
    return True, settled & TERMINAL != 0


@cached_njit(nogil=True)
def _fit_all(buffer, action, table, inputs, state, flow, observed, over, dt, room):
    """Write how each outcome fits an observation; return how many explain it.

    After the end of an episode, a state need not be what the file says: an end is explained by the
    outcomes that end the episode, and by those of them that predict the state, if any do.
    """
    fits, ends = advanced(room, FIT * c.KINDS), advanced(room, ENDS * c.KINDS)
    exact, ending, kinds = 0, 0, int(table[c.T_KINDS])
    for kind in range(kinds):
        fits[kind], ends[kind] = IMPOSSIBLE, 0.0
        if not predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            continue
        same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
        same = same and (end or not over)
        fits[kind], ends[kind] = FITS if same else POSSIBLE, 1.0 if end else 0.0
        exact += same
        ending += end
    if exact > 0 or not over:
        return exact
    for kind in range(kinds):
        if ends[kind] != 0.0:
            fits[kind] = FITS
    return ending


@cached_njit(nogil=True)
def _find_new(buffer, action, table, inputs, state, flow, observed, over, dt, room):
    """Add outcomes that explain an observation, those of other actions first; return the number."""
    schemas, fits = int(table[c.T_SCHEMAS]), advanced(room, FIT * c.KINDS)
    before = int(table[c.T_KINDS])
    for schema in range(int(buffer[b.SCHEMAS])):
        kind = int(table[c.T_KINDS])
        if kind == c.KINDS:
            break
        known = False
        for other in range(1, before):
            known = known or table[schemas + other] == schema
        if known:
            continue
        table[schemas + kind] = schema
        if predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
            if same and (end or not over):
                fits[kind] = FITS
                table[c.T_KINDS] = kind + 1
    kind, columns = int(table[c.T_KINDS]), int(table[c.T_COLUMNS])
    if kind == before and kind < c.KINDS and not over:
        table[schemas + kind] = CHANGE
        fits[kind] = FITS
        changes, places = int(table[c.T_CHANGES]) + kind * columns, int(table[c.T_PLACES])
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            table[changes + k] = observed[column] - state[column]
        table[c.T_KINDS] = kind + 1
    return int(table[c.T_KINDS]) - before


@cached_njit(nogil=True, forceinline=True)
def _score(table, room, width):
    """Return the Brier score of the probabilities, of outcomes told apart by what they predict."""
    probabilities, fits = room, advanced(room, FIT * c.KINDS)
    score, right, left, columns = 1.0, 0.0, 0.0, int(table[c.T_COLUMNS])
    kinds = int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] != IMPOSSIBLE:
            left += probabilities[kind]
    if left <= 0.0:
        return 2.0
    for kind in range(kinds):
        if fits[kind] == IMPOSSIBLE:
            continue
        p = probabilities[kind] / left
        if fits[kind] == FITS:
            right += p
        for other in range(kinds):
            if fits[other] != IMPOSSIBLE and alike(room, width, columns, kind, other):
                score += p * probabilities[other] / left
    return score - 2.0 * right


@cached_njit(nogil=True)
def _judge(table, inputs, state, rows, room, known):
    """Compute the probabilities of the outcomes; where `known`, weigh experts by what came."""
    probabilities, fits = room, advanced(room, FIT * c.KINDS)
    scratch = advanced(room, SCRATCH * c.KINDS)
    c.fill_broadest(table, probabilities)
    c.fill_broadest(table, scratch)
    if known:
        c.weigh_experts(table, c.BY_PREDICATES, rows[0], probabilities, fits)
        c.weigh_experts(table, c.BY_NUMBERS, rows[1], scratch, fits)
    c.refine(table, c.BY_PREDICATES, rows[0], probabilities)
    c.refine(table, c.BY_NUMBERS, rows[1], scratch)
    by_predicates = c.share_of(table, probabilities, fits)
    by_numbers = c.share_of(table, scratch, fits)
    c.mix_paths(table, probabilities, scratch)
    if known:
        c.weigh_experts(table, c.BY_BOTH, rows[2], probabilities, fits)
        c.weigh_paths(table, by_predicates, by_numbers)
    c.refine(table, c.BY_BOTH, rows[2], probabilities)


@cached_njit(nogil=True)
def _add(table, rows, room):
    """Divide a sample among the outcomes that fit, by their probabilities."""
    probabilities, fits = room, advanced(room, FIT * c.KINDS)
    total, members, kinds = 0.0, 0, int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] == FITS:
            probabilities[kind] += c.LEAST
            total += probabilities[kind]
            members |= 1 << kind
    for kind in range(kinds):
        if fits[kind] == FITS:
            for row in rows:
                if row > 0:
                    c.add_share(table, row, kind, probabilities[kind] / total)
    c.share_sets(table, members, advanced(room, SCRATCH * c.KINDS))


@cached_njit(nogil=True)
def _count(buffer, group, table, sample, flow, dt, losses, rate, room):
    # Pointers into an array keep it alive only where the array is an argument.
    state, action, observed, over = sample
    flowed, flags = flow
    base, counts = pointer_to(buffer, 0), pointer_to(table, 0)
    source, target = pointer_to(state, 0), pointer_to(observed, 0)
    scratch, seen = pointer_to(room, 0), (pointer_to(flowed, 0), flags)
    inputs, width = advanced(base, int(base[group + b.G_INPUTS])), state.shape[0]
    _extend(counts, inputs, source)
    if not over:
        _extend(counts, inputs, target)
    fitting = _fit_all(base, action, counts, inputs, source, seen, target, over, dt, scratch)
    fits, before = advanced(scratch, FIT * c.KINDS), int(counts[c.T_KINDS])
    rows = (
        c.find_or_enter(counts, inputs, source, c.BY_PREDICATES),
        c.find_or_enter(counts, inputs, source, c.BY_NUMBERS),
        c.find_or_enter(counts, inputs, source, c.BY_BOTH),
    )
    _judge(counts, inputs, source, rows, scratch, fitting > 0)
    if fitting > 0 or not over:
        score = _score(counts, scratch, width)
        losses[0] += rate * ((0.0 if fits[0] == FITS else 2.0) - losses[0])
        losses[1] += rate * (score - losses[1])
    if fitting == 0:
        found = _find_new(base, action, counts, inputs, source, seen, target, over, dt, scratch)
        if found == 0:
            return over
        for kind in range(before, before + found):
            scratch[kind] = 1.0
    _add(counts, rows, scratch)
    return True


@cached_njit(nogil=True)
def count(buffer, position, table, sample, flow, dt, losses, rate):
    """Update the losses with a new sample, and then count it; all arguments are arrays.

    `position` is that of the group among those of the action. `sample` is (state `[F]`, action, the
    observed next state, whether the episode is over), `flow` (state and reward after effects and
    processes, the flags of these). `losses` `[2]` are moving averages of the
    Brier scores (Monthly Weather Review 78, 1950) of the file and of the counts, `rate` the weight
    of this sample in them.

    Returns:
        False where it is no outcome, and there is no room for another.
    """
    group = int(buffer[int(buffer[b.TABLE]) + 2 * sample[1] + 1]) + position * b.GROUP
    room = np.empty(room_for(sample[0].shape[0]))
    return _count(buffer, group, table, sample, flow, dt, losses, rate, room)
