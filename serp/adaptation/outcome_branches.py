"""The compiled function that gives all outcomes of an adapted step, with their probabilities."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from serp._util.compilation import cached_cfunc, cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.adapted_step import adapted_row, finite, flow_and_residual
from serp.adaptation.file_step import settle
from serp.adaptation.outcomes import table_kernels as o
from serp.adaptation.outcomes.prediction_kernels import RARE, likeliest, put, room_for, table_of
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import OUTCOMES, STEP_SIGNATURE, advanced, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


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
def _outcomes_within(state, action, buffer, dt, out, scratch):
    # Pointers into an array keep it alive only where the array is an argument.
    room = pointer_to(scratch, 0)
    width = int(buffer[b.WIDTH])
    row = width + 3
    table = int(buffer[b.TABLE]) + 2 * action
    groups, first = int(buffer[table]), int(buffer[table + 1])
    counted = False
    if buffer[b.ACTIVE] != 0.0 and buffer[b.STOCHASTIC] != 0.0:
        for v in range(groups):
            counted = counted or table_of(buffer, first + v * b.GROUP) != 0
    if not counted:
        return _one_outcome(state, action, buffer, dt, out, width)
    before = flow_and_residual(buffer, action, state, dt, out)
    if not before & APPLICABLE or not finite(out, width):
        return _one_outcome(state, action, buffer, dt, out, width)
    out[width + 2] = 1.0
    count = 1
    flowed = advanced(room, room_for(width))
    for i in range(width):
        flowed[i] = out[i]
    for v in range(groups):
        group = first + v * b.GROUP
        if table_of(buffer, group) != 0:
            count = _branch(buffer, action, group, state, flowed, dt, out, count, room)
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


@cached_njit(nogil=True, forceinline=True)
def _outcomes(state, action, buffer, dt, out):
    width = int(buffer[b.WIDTH])
    scratch = np.empty(room_for(width) + width)
    return _outcomes_within(state, action, buffer, dt, out, scratch)


def _step(state, action, buffer, dt, out):
    return _outcomes(state, action, buffer, dt, out)


@functools.cache
def adapted_outcomes() -> Any:
    """Return the compiled C callback; see `TransitionModel.native_outcomes`."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_step)
