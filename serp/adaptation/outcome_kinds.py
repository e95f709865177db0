"""The compiled outcomes of an action: what they predict, and the counting of observations.

An outcome is what the file predicts for the action, what it predicts for another action with the
same arguments (a robot that slips; walls and conditions of the file hold then, too), or a change of
the state. Several may explain one observation, at a wall for example: the sample is divided among
them by their current probabilities (online expectation-maximisation: Cappé & Moulines, Journal of
the Royal Statistical Society B 71, 2009).

`buffer` is the memory of `serp.adaptation.parameter_buffer`, `table` that of
`serp.adaptation.outcome_kernels`, all as pointers. `room` is scratch memory, see `room_for`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.adaptation import outcome_kernels as c
from serp.adaptation import parameter_buffer as b
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import advanced, call_step, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

RARE = 1e-3
"""Less likely outcomes are left out of predictions."""
CHANGE = -1.0
"""In place of an action schema: the outcome is a change."""
_IMPOSSIBLE, _POSSIBLE, _FITS = range(3)

# Positions in `room`, in multiples of KINDS, before a step `[F + 1]` and values `[KINDS, columns]`.
_PROBABILITIES, _SCRATCH, _FIT, _ENDS, _STEP = range(5)


@cached_njit(nogil=True, forceinline=True)
def room_for(width):
    """Return the length of the scratch memory for states of `width` fluents."""
    return _STEP * c.KINDS + width + 1 + c.KINDS * width


@cached_njit(nogil=True, forceinline=True)
def values_of(room, width, columns, kind):
    """Return a pointer to the counted fluents that an outcome predicts."""
    return advanced(room, _STEP * c.KINDS + width + 1 + kind * columns)


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
    width = int(buffer[b.WIDTH])
    for i in range(width):
        step[i] = state[i]
    step[width] = 0.0
    parameters = advanced(buffer, int(buffer[b.PARAMETERS]))
    flags = call_step(int(buffer[b.FLOW]), state, other, parameters, dt, step)
    if not flags & APPLICABLE:
        return False
    places = int(table[c.T_PLACES])
    for k in range(int(table[c.T_COLUMNS])):
        values[k] = step[int(inputs[int(table[places + k])])]
    return True


@cached_njit(nogil=True, forceinline=True)
def _by_change(table, kind, inputs, state, values):
    """Write the counted fluents after a change.

    Returns:
        Whether those that change are within the ranges in which they were observed.
    """
    columns, places, ranges = (
        int(table[c.T_COLUMNS]),
        int(table[c.T_PLACES]),
        int(table[c.T_RANGES]),
    )
    changes = int(table[c.T_CHANGES]) + kind * columns
    within = True
    for k in range(columns):
        by = table[changes + k]
        values[k] = state[int(inputs[int(table[places + k])])] + by
        inside = table[ranges + 2 * k] <= values[k] <= table[ranges + 2 * k + 1]
        within = within and (by == 0.0 or inside)
    return within


@cached_njit(nogil=True, forceinline=True)
def _predict(buffer, action, table, kind, inputs, state, flowed, dt, room):
    """Write what an outcome predicts, see `values_of`; return whether it is possible.

    `flowed` `[F]` is the state after effects, processes and residual.
    """
    width, columns = int(buffer[b.WIDTH]), int(table[c.T_COLUMNS])
    values = values_of(room, width, columns, kind)
    if kind == 0:
        places = int(table[c.T_PLACES])
        for k in range(columns):
            values[k] = flowed[int(inputs[int(table[places + k])])]
        return True
    schema = table[int(table[c.T_SCHEMAS]) + kind]
    if schema == CHANGE:
        return _by_change(table, kind, inputs, state, values)
    step = advanced(room, _STEP * c.KINDS)
    return _by_schema(buffer, action, int(schema), table, inputs, state, dt, values, step)


@cached_njit(nogil=True, forceinline=True)
def put(buffer, table, kind, inputs, room, out):
    """Set the counted fluents as an outcome predicts."""
    columns, places = int(table[c.T_COLUMNS]), int(table[c.T_PLACES])
    values = values_of(room, int(buffer[b.WIDTH]), columns, kind)
    for k in range(columns):
        out[int(inputs[int(table[places + k])])] = values[k]


@cached_njit(nogil=True, forceinline=True)
def _alike(room, width, columns, kind, other):
    one, two = values_of(room, width, columns, kind), values_of(room, width, columns, other)
    different = 0
    for k in range(columns):
        different += one[k] != two[k]
    return different == 0


@cached_njit(nogil=True, forceinline=True)
def _merge(table, room, width, probabilities):
    """Give the probability of outcomes that predict the same to the first of them."""
    columns = int(table[c.T_COLUMNS])
    for kind in range(1, int(table[c.T_KINDS])):
        for other in range(kind):
            both = probabilities[kind] > 0.0 and probabilities[other] > 0.0
            if both and _alike(room, width, columns, kind, other):
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
    probabilities, scratch = room, advanced(room, _SCRATCH * c.KINDS)
    c.fill_probabilities(table, inputs, state, probabilities, scratch)
    kinds, left = int(table[c.T_KINDS]), 0.0
    for kind in range(kinds):
        usual = kind == 0 or probabilities[kind] >= RARE
        if not (usual and _predict(buffer, action, table, kind, inputs, state, flowed, dt, room)):
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


# Counting --------------------------------------------------------------------------------------


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
    out = advanced(room, _STEP * c.KINDS)
    for i in range(width + 1):
        out[i] = flowed[i]
    put(buffer, table, kind, inputs, room, out)
    parameters = advanced(buffer, int(buffer[b.PARAMETERS]))
    settled = call_step(int(buffer[b.SETTLE]), state, flags, parameters, dt, out)
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
    fits, ends = advanced(room, _FIT * c.KINDS), advanced(room, _ENDS * c.KINDS)
    exact, ending, kinds = 0, 0, int(table[c.T_KINDS])
    for kind in range(kinds):
        fits[kind], ends[kind] = _IMPOSSIBLE, 0.0
        if not _predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            continue
        same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
        same = same and (end or not over)
        fits[kind], ends[kind] = _FITS if same else _POSSIBLE, 1.0 if end else 0.0
        exact += same
        ending += end
    if exact > 0 or not over:
        return exact
    for kind in range(kinds):
        if ends[kind] != 0.0:
            fits[kind] = _FITS
    return ending


@cached_njit(nogil=True)
def _find_new(buffer, action, table, inputs, state, flow, observed, over, dt, room):
    """Add outcomes that explain an observation, those of other actions first; return the number."""
    schemas, fits = int(table[c.T_SCHEMAS]), advanced(room, _FIT * c.KINDS)
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
        if _predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
            if same and (end or not over):
                fits[kind] = _FITS
                table[c.T_KINDS] = kind + 1
    kind, columns = int(table[c.T_KINDS]), int(table[c.T_COLUMNS])
    if kind == before and kind < c.KINDS and not over:
        table[schemas + kind] = CHANGE
        fits[kind] = _FITS
        changes, places = int(table[c.T_CHANGES]) + kind * columns, int(table[c.T_PLACES])
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            table[changes + k] = observed[column] - state[column]
        table[c.T_KINDS] = kind + 1
    return int(table[c.T_KINDS]) - before


@cached_njit(nogil=True, forceinline=True)
def _score(table, room, width):
    """Return the Brier score of the probabilities, of outcomes told apart by what they predict."""
    probabilities, fits = room, advanced(room, _FIT * c.KINDS)
    score, right, left, columns = 1.0, 0.0, 0.0, int(table[c.T_COLUMNS])
    kinds = int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] != _IMPOSSIBLE:
            left += probabilities[kind]
    if left <= 0.0:
        return 2.0
    for kind in range(kinds):
        if fits[kind] == _IMPOSSIBLE:
            continue
        p = probabilities[kind] / left
        if fits[kind] == _FITS:
            right += p
        for other in range(kinds):
            if fits[other] != _IMPOSSIBLE and _alike(room, width, columns, kind, other):
                score += p * probabilities[other] / left
    return score - 2.0 * right


@cached_njit(nogil=True)
def _judge(table, inputs, state, rows, room, known):
    """Compute the probabilities of the outcomes; where `known`, weigh experts by what came."""
    probabilities, fits = room, advanced(room, _FIT * c.KINDS)
    scratch = advanced(room, _SCRATCH * c.KINDS)
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
def _add(table, rows, probabilities, fits):
    """Divide a sample among the outcomes that fit, by their probabilities."""
    total, kinds = 0.0, int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] == _FITS:
            probabilities[kind] += c.LEAST
            total += probabilities[kind]
    for kind in range(kinds):
        if fits[kind] == _FITS:
            share = probabilities[kind] / total
            c.add_share(table, 0, kind, share)
            for row in rows:
                if row > 0:
                    c.add_share(table, row, kind, share)


@cached_njit(nogil=True)
def _count(buffer, group, table, sample, dt, losses, rate, room, flowed):
    # Pointers into an array keep it alive only where the array is an argument.
    action, state, observed, over = sample
    base, counts = pointer_to(buffer, 0), pointer_to(table, 0)
    source, target = pointer_to(state, 0), pointer_to(observed, 0)
    scratch, flow = pointer_to(room, 0), pointer_to(flowed, 0)
    inputs, width = advanced(base, int(base[group + b.G_INPUTS])), state.shape[0]
    for i in range(width):
        flow[i] = source[i]
    flow[width] = 0.0
    parameters = advanced(base, int(base[b.PARAMETERS]))
    flags = call_step(int(base[b.FLOW]), source, action, parameters, dt, flow)
    if not flags & APPLICABLE:
        return True
    _extend(counts, inputs, source)
    if not over:
        _extend(counts, inputs, target)
    seen = (flow, flags)
    fitting = _fit_all(base, action, counts, inputs, source, seen, target, over, dt, scratch)
    fits, before = advanced(scratch, _FIT * c.KINDS), int(counts[c.T_KINDS])
    rows = (
        c.find_or_enter(counts, inputs, source, c.BY_PREDICATES),
        c.find_or_enter(counts, inputs, source, c.BY_NUMBERS),
        c.find_or_enter(counts, inputs, source, c.BY_BOTH),
    )
    _judge(counts, inputs, source, rows, scratch, fitting > 0)
    if fitting > 0 or not over:
        score = _score(counts, scratch, width)
        losses[0] += rate * ((0.0 if fits[0] == _FITS else 2.0) - losses[0])
        losses[1] += rate * (score - losses[1])
    if fitting == 0:
        found = _find_new(base, action, counts, inputs, source, seen, target, over, dt, scratch)
        if found == 0:
            return over
        for kind in range(before, before + found):
            scratch[kind] = 1.0
    _add(counts, rows, scratch, fits)
    return True


@cached_njit(nogil=True)
def count(buffer, position, table, sample, dt, losses, rate):
    """Update the losses with a new sample, and then count it; all arguments are arrays.

    `position` is that of the group among those of the action. `sample` is (action, state `[F]`, the
    observed next state, whether the episode is over). `losses` `[2]` are moving averages of the
    Brier scores (Monthly Weather Review 78, 1950) of the file and of the counts, `rate` the weight
    of this sample in them.

    Returns:
        False where it is no outcome, and there is no room for another.
    """
    width, action = sample[1].shape[0], sample[0]
    group = int(buffer[int(buffer[b.TABLE]) + 2 * action + 1]) + position * b.GROUP
    room, flowed = np.empty(room_for(width)), np.empty(width + 1)
    return _count(buffer, group, table, sample, dt, losses, rate, room, flowed)
