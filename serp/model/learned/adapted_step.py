"""The compiled step of the adapted model, the same for every domain; and how far it is from data.

`buffer` is the memory of `serp.model.learned.parameter_buffer`, as a pointer unless said otherwise.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from serp._util.compilation import cached_cfunc, cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE, with_risk
from serp.model.learned import outcome_table as o
from serp.model.learned import parameter_buffer as b
from serp.model.learned import residual_features as r
from serp.model.learned.outcome_table import RARE, likeliest, put, room_for, table_of
from serp.model.learned.parameter_buffer import flow, settle
from serp.model.learned.residual_features import dot_chunk, features_of, linear_of, normalise
from serp.model.native import (
    OUTCOMES,
    STACK,
    STEP_SIGNATURE,
    advanced,
    call_step,
    pointer_to,
    stack_room,
)
from serp.model.transition_model import UNKNOWN

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_with_risk = cached_njit(nogil=True, forceinline=True)(with_risk)


@cached_njit(nogil=True, forceinline=True)
def columns_in_use(known, columns, most):
    """Return how many columns of the regression tell what is known.

    Where no target is predicted from features (`most` is the largest of the kinds in use), what the
    linear model knows is known.
    """
    return min(known, columns) if most <= r.LINEAR else known


@cached_njit(nogil=True, forceinline=True)
def leverage(inverse, stride, known, columns, head, u, depth, z):
    """Return the leverage of an input: 0 where much is known, 1 where nothing is.

    It is q / (1 + q), where q is the posterior variance of the smooth model in units of that of an
    observation. `inverse` is that of the Cholesky factor, of `known` columns; `z` are the features.
    """
    if known == 0:
        return 1.0
    q = 0.0
    block = 1 + depth
    for i in range(known):
        total, at = 0.0, i * stride
        for start in (0, (1 + head) * block):
            if start > i:
                break
            total += inverse[at + start]
            for k in range(min(depth, i - start)):
                total += inverse[at + start + 1 + k] * u[k]
        for k in range(i + 1 - columns):
            total += inverse[at + columns + k] * z[k]
        q += total * total
    return q / (1.0 + q)


@cached_njit(nogil=True, forceinline=True)
def leverage_at(buffer, part, head, most, u, depth, z):
    """Return the leverage of normalised inputs where `most` is the largest kind in use.

    `z` receives the features.
    """
    columns = (1 + int(buffer[part + r.R_HEADS])) * (1 + depth)
    known = columns_in_use(int(buffer[part + r.R_KNOWN]), columns, most)
    if known > columns:
        features_of(
            advanced(buffer, int(buffer[part + r.R_FREQUENCY])),
            advanced(buffer, int(buffer[part + r.R_PHASE])), u, depth, 0, z,
        )  # fmt: skip
    return leverage(
        advanced(buffer, int(buffer[part + r.R_INVERSE])), columns + r.SMOOTH, known, columns,
        head, u, depth, z,
    )  # fmt: skip


@cached_njit(nogil=True, forceinline=True)
def add_residual(buffer, action, state, out):
    """Add the residual to `out`, the fluents after effects and processes.

    Beyond the range of the data, where these say less than the prior, the linear model replaces one
    with features, as in a Gaussian process whose mean is linear: waves say nothing of far away.
    """
    table = int(buffer[b.TABLE]) + 2 * action
    group = int(buffer[table + 1])
    u = stack_room(STACK)
    z, scratch = advanced(u, r.MAX_INPUTS), advanced(u, r.MAX_INPUTS + r.SMOOTH)
    for _ in range(int(buffer[table])):
        part = int(buffer[int(buffer[group + b.G_SHARED]) + b.S_REGRESSION])
        if part != 0:
            inputs, targets = int(buffer[group + b.G_INPUTS]), int(buffer[group + b.G_TARGETS])
            depth, count = int(buffer[group + b.G_DEPTH]), int(buffer[group + b.G_COUNT])
            head = int(buffer[int(buffer[group + b.G_SHARED]) + b.S_HEAD])
            kinds = int(buffer[part + r.R_KINDS])
            linear = int(buffer[part + r.R_LINEAR]) + 3 * head * count * (1 + depth)
            amplitude = int(buffer[part + r.R_AMPLITUDE])
            most = 0
            for t in range(count):
                most = max(most, int(buffer[kinds + t]))
            if most != r.FILE:
                normalise(buffer, part, inputs, depth, state, u)
            if most > r.LINEAR:
                inside = True
                for i in range(depth):
                    inside = inside and abs(u[i]) <= r.RANGE
                if not inside:
                    far = leverage_at(buffer, part, head, most, u, depth, z) >= UNKNOWN
                    most = r.LINEAR if far else most
            for t in range(count):
                kind = min(int(buffer[kinds + t]), most)
                if kind != r.FILE:
                    weights = linear + ((kind - 1) * count + t) * (1 + depth)
                    out[int(buffer[targets + t])] += linear_of(advanced(buffer, weights), u, depth)
            chunks = 0
            if most > r.LINEAR:
                chunks = 1 if most == r.CURVED else r.FEATURES // r.SMOOTH
            frequency = advanced(buffer, int(buffer[part + r.R_FREQUENCY]))
            phase = advanced(buffer, int(buffer[part + r.R_PHASE]))
            for chunk in range(chunks):
                first = chunk * r.SMOOTH
                features_of(frequency, phase, u, depth, first, z)
                for t in range(count):
                    kind = int(buffer[kinds + t])
                    if kind == r.FULL or (kind == r.CURVED and chunk == 0):
                        weights = amplitude + ((kind - r.CURVED) * count + t) * r.FEATURES + first
                        product = dot_chunk(advanced(buffer, weights), z, scratch)
                        out[int(buffer[targets + t])] += product
        group += b.GROUP


@cached_njit(nogil=True, forceinline=True)
def finite(values, width):
    """Return whether all of the first `width` values are finite."""
    difference = 0.0
    for i in range(width):
        difference += values[i] - values[i]
    return difference == 0.0


@cached_njit(nogil=True, forceinline=True)
def _counted(buffer, action):
    """Return whether outcome counts are used in a step."""
    table = int(buffer[b.TABLE]) + 2 * action
    if buffer[b.STOCHASTIC] != 0.0:
        for v in range(int(buffer[table])):
            if table_of(buffer, int(buffer[table + 1]) + v * b.GROUP) != 0:
                return True
    return False


@cached_njit(nogil=True, forceinline=True)
def _corrected(buffer, action):
    """Return whether a residual is used in a step."""
    table = int(buffer[b.TABLE]) + 2 * action
    for v in range(int(buffer[table])):
        group = int(buffer[table + 1]) + v * b.GROUP
        part = int(buffer[int(buffer[group + b.G_SHARED]) + b.S_REGRESSION])
        if part == 0:
            continue
        kinds = int(buffer[part + r.R_KINDS])
        for t in range(int(buffer[group + b.G_COUNT])):
            if buffer[kinds + t] != r.FILE:
                return True
    return False


@cached_njit(nogil=True)
def _apply_likeliest(buffer, action, state, dt, out, room):
    """Apply the likeliest counted outcome of each group to `out`.

    `out` `[F]` is the state after effects, processes and residual. `room` is that of `likeliest`,
    followed by F + 1 numbers.

    Returns:
        The number of groups with counts, and the outcome of the last of these.
    """
    table = int(buffer[b.TABLE]) + 2 * action
    group = int(buffer[table + 1])
    counted, which = 0, 0
    width = int(buffer[b.WIDTH])
    flowed = advanced(room, room_for(width))
    for i in range(width):
        flowed[i] = out[i]
    for _ in range(int(buffer[table])):
        where = table_of(buffer, group)
        if where != 0:
            counted += 1
            inputs = advanced(buffer, int(buffer[group + b.G_INPUTS]))
            which = likeliest(buffer, action, group, state, flowed, dt, room)
            if which > 0:
                put(buffer, advanced(buffer, where), which, inputs, room, out)
        group += b.GROUP
    return counted, which


@cached_njit(nogil=True)
def _settle_outcomes(buffer, action, state, flow_flags, dt, out, scratch):
    """Apply the likeliest outcomes and then events; the reward is expected over all outcomes.

    Groups are varied one at a time: their outcomes are assumed to be independent.

    Returns:
        Flags of the likeliest outcome, and the probability that events flag the step unsafe.
    """
    width = int(buffer[b.WIDTH])
    # The result with the likeliest outcomes, before and after one of them is replaced. Pointers
    # into an array keep it alive only where the array is an argument.
    room = pointer_to(scratch, 0)
    usual, other = room, advanced(room, width + 1)
    # The probabilities, what the outcomes predict, and the result of effects and processes.
    probabilities = advanced(room, 2 * (width + 1))
    flowed = advanced(probabilities, room_for(width))
    counted, likeliest_of_all = _apply_likeliest(buffer, action, state, dt, out, probabilities)
    for i in range(width + 1):
        usual[i] = out[i]
    flags = settle(buffer, state, flow_flags, dt, out)
    unsafe = flags & UNSAFE != 0
    if counted == 0 or not flags & APPLICABLE:
        return flags, 1.0 if unsafe else 0.0
    table = int(buffer[b.TABLE]) + 2 * action
    group = int(buffer[table + 1])
    reward = out[width]
    expected, alike = reward, 1.0
    for _ in range(int(buffer[table])):
        where = table_of(buffer, group)
        if where != 0:
            counts = advanced(buffer, where)
            inputs = advanced(buffer, int(buffer[group + b.G_INPUTS]))
            most = likeliest_of_all  # and what is in `room` is its own, if no other has counts
            if counted > 1:
                most = likeliest(buffer, action, group, state, flowed, dt, probabilities)
            different = 0.0
            for kind in range(int(counts[o.T_KINDS])):
                p = probabilities[kind]
                if kind == most or p <= 0.0:
                    continue
                for i in range(width + 1):
                    other[i] = usual[i]
                put(buffer, counts, kind, inputs, probabilities, other)
                changed = settle(buffer, state, flow_flags, dt, other)
                undefined = changed & UNDEFINED != 0
                flagged = changed & UNSAFE != 0
                if flagged != unsafe and (flagged or not undefined):
                    different += p
                if not undefined and math.isfinite(other[width]):
                    expected += p * (other[width] - reward)
            alike *= max(0.0, 1.0 - different)
        group += b.GROUP
    if math.isfinite(expected):
        out[width] = expected
    return flags, alike if unsafe else 1.0 - alike


@cached_njit(nogil=True, forceinline=True)
def flow_and_residual(buffer, action, state, dt, out):
    """Do what `flow` does, and add the residual; ignore it where the result is not finite."""
    flags = flow(buffer, action, state, dt, out)
    if flags & APPLICABLE:
        add_residual(buffer, action, state, out)
        if not finite(out, int(buffer[b.WIDTH])):
            flags = flow(buffer, action, state, dt, out)
    return flags


@cached_njit(nogil=True, forceinline=True)
def adapted_row(state, action, buffer, dt, out):
    """Predict the adapted step."""
    revised = buffer[b.REVISED] != 0.0
    differs = revised or _counted(buffer, action) or _corrected(buffer, action)
    if buffer[b.ACTIVE] == 0.0 or not differs:
        return call_step(
            int(buffer[b.STEP]), state, action, advanced(buffer, int(buffer[b.WRITTEN])), dt, out
        )
    known = revised or buffer[b.FLAGGING] != 0.0
    flagged = 0
    if known:
        # UNSAFE is set by the file as written. With its parameters, effects and processes set the
        # same flags in both steps, but events may not.
        flagged = UNSAFE & call_step(
            int(buffer[b.STEP]), state, action, advanced(buffer, int(buffer[b.WRITTEN])), dt, out
        )
    flags = flow_and_residual(buffer, action, state, dt, out)
    risk = 0.0
    if flags & APPLICABLE:
        if buffer[b.STOCHASTIC] == 0.0:
            flags = settle(buffer, state, flags, dt, out)
            risk = 1.0 if flags & UNSAFE else 0.0
        else:
            width = int(buffer[b.WIDTH])
            scratch = np.empty(3 * (width + 1) + room_for(width))
            flags, risk = _settle_outcomes(buffer, action, state, flags, dt, out, scratch)
    if not known:
        flagged = flags & UNSAFE
    flags = flags & ~UNSAFE | flagged
    return _with_risk(flags, risk) if flags & APPLICABLE and not flagged else flags


def _step(state, action, buffer, dt, out):
    return adapted_row(state, action, buffer, dt, out)


@functools.cache
def adapted_step() -> Any:
    """Return the compiled C callback of the adapted step; its data is a buffer."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_step)


@cached_njit(nogil=True)
def step_row(buffer, action, state, dt, out):
    """Predict the adapted step on arrays; `out` `[F + 1]` begins with the state, then 0."""
    return adapted_row(pointer_to(state, 0), action, pointer_to(buffer, 0), dt, pointer_to(out, 0))


@cached_njit(nogil=True, forceinline=True)
def _one_outcome(state, action, buffer, dt, out, width):
    """Write the step that the model predicts as its only outcome."""
    for i in range(width):
        out[i] = state[i]
    out[width] = 0.0
    out[width + 1] = adapted_row(state, action, buffer, dt, out)
    out[width + 2] = 1.0
    return 1


@cached_njit(nogil=True)
def _branch(buffer, action, group, state, flowed, dt, out, count, room):
    """Split every outcome found so far by the counted outcomes of a group; return their number."""
    counts = advanced(buffer, table_of(buffer, group))
    inputs = advanced(buffer, int(buffer[group + b.G_INPUTS]))
    likeliest(buffer, action, group, state, flowed, dt, room)
    width, before = int(buffer[b.WIDTH]), count
    row = width + 3
    for source in range(before):
        old = advanced(out, source * row)
        left = old[width + 2]
        for kind in range(1, int(counts[o.T_KINDS])):
            chance = left * room[kind]
            if chance < RARE or count == OUTCOMES:
                continue
            new = advanced(out, count * row)
            for i in range(row):
                new[i] = old[i]
            put(buffer, counts, kind, inputs, room, new)
            new[width + 2] = chance
            count += 1
        old[width + 2] = left * room[0]
    return count


@cached_njit(nogil=True)
def _branches(state, action, buffer, dt, out, scratch):
    """Write every outcome before events, with its probability, in rows of F + 3 numbers.

    Returns:
        The number of outcomes, 0 where there is no result; and the flags so far.
    """
    # Pointers into an array keep it alive only where the array is an argument.
    room = pointer_to(scratch, 0)
    width = int(buffer[b.WIDTH])
    flags = flow_and_residual(buffer, action, state, dt, out)
    if not flags & APPLICABLE or not finite(out, width):
        return 0, flags
    out[width + 2] = 1.0
    count = 1
    flowed = advanced(room, room_for(width))
    for i in range(width):
        flowed[i] = out[i]
    table = int(buffer[b.TABLE]) + 2 * action
    for v in range(int(buffer[table])):
        group = int(buffer[table + 1]) + v * b.GROUP
        if table_of(buffer, group) != 0:
            count = _branch(buffer, action, group, state, flowed, dt, out, count, room)
    return count, flags


@cached_njit(nogil=True)
def branch_rows(buffer, action, state, dt, out):
    """Write every outcome before events to `out`, flat `[OUTCOMES * (F + 3)]`; return the number.

    Each is a state, the reward so far, 0 and its probability; all arguments are arrays.
    """
    width = state.shape[0]
    scratch = np.empty(room_for(width) + width)
    return _branches(
        pointer_to(state, 0), action, pointer_to(buffer, 0), dt, pointer_to(out, 0), scratch
    )[0]


@cached_njit(nogil=True, forceinline=True)
def _outcomes(state, action, buffer, dt, out):
    width = int(buffer[b.WIDTH])
    row = width + 3
    count, before = 0, 0
    if buffer[b.ACTIVE] != 0.0 and _counted(buffer, action):
        scratch = np.empty(room_for(width) + width)
        count, before = _branches(state, action, buffer, dt, out, scratch)
    if count == 0:
        return _one_outcome(state, action, buffer, dt, out, width)
    kept, total = 0, 0.0
    for k in range(count):
        source, target = advanced(out, k * row), advanced(out, kept * row)
        if source[width + 2] < RARE:
            continue
        for i in range(row):
            target[i] = source[i]
        flags = settle(buffer, state, before, dt, target)
        if not flags & APPLICABLE:
            for i in range(width + 1):
                target[i] = source[i]
            flags = before & ~TERMINAL
        target[width + 1] = flags
        total += target[width + 2]
        kept += 1
    for k in range(kept):
        out[k * row + width + 2] /= total
    return kept


def _step_of_outcome_branches(state, action, buffer, dt, out):
    return _outcomes(state, action, buffer, dt, out)


@functools.cache
def adapted_outcomes() -> Any:
    """Return the compiled C callback; see `TransitionModel.native_outcomes`."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_step_of_outcome_branches)


@cached_njit(nogil=True)
def uncertainty_of(buffer, action, state):
    """Return the largest leverage of what the file does not predict; all are pointers.

    The file predicts what has typical errors of at most half of the change.
    """
    table = int(buffer[b.TABLE]) + 2 * action
    group, unknown = int(buffer[table + 1]), 0.0
    u = stack_room(STACK)
    z = advanced(u, r.MAX_INPUTS)
    for _ in range(int(buffer[table])):
        shared = int(buffer[group + b.G_SHARED])
        part = int(buffer[shared + b.S_REGRESSION])
        if part != 0:
            inputs, count = int(buffer[group + b.G_INPUTS]), int(buffer[group + b.G_COUNT])
            depth = int(buffer[group + b.G_DEPTH])
            head = int(buffer[shared + b.S_HEAD])
            known, kinds = int(buffer[part + r.R_KNOWN]), int(buffer[part + r.R_KINDS])
            heads, typical = int(buffer[part + r.R_HEADS]), int(buffer[part + r.R_TYPICAL])
            change = int(buffer[part + r.R_SCALE]) + count
            most, written = 0.0, known > 0
            for t in range(count):
                most = max(most, buffer[kinds + t])
                for each in range(heads):  # a head without samples says nothing of the file
                    if buffer[typical + each * count + t] > 0.5 * buffer[change + t]:
                        written = False
            if not (written and most == r.FILE):
                normalise(buffer, part, inputs, depth, state, u)
                unknown = max(unknown, leverage_at(buffer, part, head, most, u, depth, z))
        group += b.GROUP
    return unknown


@cached_njit(nogil=True)
def uncertainty(buffer, action, state):
    """Return how far a step is from the data, from 0 to 1.

    It is about 1 over the number of samples like this one, 1 where there are none, and 0 where the
    file alone predicts.

    Args:
        buffer: `AdaptedModel.data`.
        action: Position of the ground action.
        state: `[F]`.
    """
    return uncertainty_of(pointer_to(buffer, 0), action, pointer_to(state, 0))


def _uncertainty(state, action, buffer, dt, out):
    out[int(buffer[b.WIDTH])] = uncertainty_of(buffer, action, state)
    return 0


@functools.cache
def native_uncertainty() -> Any:
    """Return the compiled C callback, see `TransitionModel.native_uncertainty`."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_uncertainty)
