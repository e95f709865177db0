"""The compiled loops of the correction, the same for every domain.

`block` is the memory of `serp.adaptation.parameter_buffer`, as a pointer.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from serp._util.compilation import cached_cfunc, cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.outcome_kernels import KINDS as _KINDS
from serp.adaptation.outcome_kernels import T_KINDS as _T_KINDS
from serp.adaptation.outcome_kernels import likeliest, put, take_back
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE, with_risk
from serp.model.native import (
    STACK,
    STEP_SIGNATURE,
    advanced,
    call_step,
    pointer_to,
    stack_room,
)

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_STEP, _FLOW, _SETTLE, _WIDTH, _ACTIVE = b.STEP, b.FLOW, b.SETTLE, b.WIDTH, b.ACTIVE
_WRITTEN, _LITERALS, _TABLE = b.WRITTEN, b.LITERALS, b.TABLE
_V_INPUTS, _V_TARGETS, _V_DEPTH = b.V_INPUTS, b.V_TARGETS, b.V_DEPTH
_V_COUNT, _V_GROUP, _VIEW = b.V_COUNT, b.V_GROUP, b.VIEW
_G_MODES, _G_BITS, _G_WAVES, _G_CODES = b.G_MODES, b.G_BITS, b.G_WAVES, b.G_CODES
_G_POSITIONS, _G_KINDS, _G_LINEAR = b.G_POSITIONS, b.G_KINDS, b.G_LINEAR
_G_CENTRE, _G_SHRINK, _G_FREQUENCY = b.G_CENTRE, b.G_SHRINK, b.G_FREQUENCY
_G_PHASE, _G_AMPLITUDE, _G_CHANCE = b.G_PHASE, b.G_AMPLITUDE, b.G_CHANCE
_REVISED, _JUDGED = b.REVISED, b.JUDGED
_FILE, _LINEAR, _WAVY, _OWN = b.FILE, b.LINEAR, b.WAVY, b.OWN
_MODES = b.MODES
_CHANCY, _AMENDS = b.CHANCY, b.AMENDS

_with_risk = cached_njit(nogil=True, forceinline=True)(with_risk)


@cached_njit(nogil=True, forceinline=True)
def wave(z):
    """Return a smooth wave of period 2π that is cheap: a cosine to within 0.001."""
    turns = z * 0.15915494309189535 + 0.25
    turns -= np.floor(turns + 0.5)
    y = 8.0 * turns - 16.0 * turns * abs(turns)
    return 0.225 * (y * abs(y) - y) + y


@cached_njit(nogil=True, forceinline=True)
def mode_of(block, group, inputs, state):
    """Return which of the group's modes a state is in; 0 for one without a model of its own."""
    bits = int(block[group + _G_BITS])
    if bits == 0:
        return 0
    positions = int(block[group + _G_POSITIONS])
    code, weight = 0.0, 1.0
    for k in range(bits):
        if state[int(block[inputs + int(block[positions + k])])] != 0.0:
            code += weight
        weight *= 2.0
    codes = int(block[group + _G_CODES])
    for mode in range(1, int(block[group + _G_MODES]) + 1):
        if block[codes + mode] == code:
            return mode
    return 0


@cached_njit(nogil=True, forceinline=True)
def amend(block, action, state, out):
    """Add to `out`, effects and processes applied, what the file does not say."""
    if block[_AMENDS] == 0.0:
        return
    table = int(block[_TABLE]) + 2 * action
    view = int(block[table + 1])
    for _ in range(int(block[table])):
        inputs, targets = int(block[view + _V_INPUTS]), int(block[view + _V_TARGETS])
        depth, count = int(block[view + _V_DEPTH]), int(block[view + _V_COUNT])
        group = int(block[view + _V_GROUP])
        mode = mode_of(block, group, inputs, state)
        kinds = int(block[group + _G_KINDS]) + mode * count
        linear = int(block[group + _G_LINEAR])
        wavy = False
        for t in range(count):
            kind = int(block[kinds + t])
            if kind == _FILE:
                continue
            row = 0
            if kind == _OWN:
                row = mode
            elif kind == _WAVY:
                row = 1 + _MODES
                wavy = True
            weights = linear + (row * count + t) * (1 + depth)
            change = block[weights]
            for i in range(depth):
                change += block[weights + 1 + i] * state[int(block[inputs + i])]
            out[int(block[targets + t])] += change
        if wavy:
            waves = int(block[group + _G_WAVES])
            centre, shrink = int(block[group + _G_CENTRE]), int(block[group + _G_SHRINK])
            frequency, phase = int(block[group + _G_FREQUENCY]), int(block[group + _G_PHASE])
            amplitude = int(block[group + _G_AMPLITUDE])
            for k in range(waves):
                z = block[phase + k]
                for i in range(depth):
                    x = (state[int(block[inputs + i])] - block[centre + i]) * block[shrink + i]
                    z += block[frequency + k * depth + i] * x
                feature = wave(z)
                for t in range(count):
                    if int(block[kinds + t]) == _WAVY:
                        out[int(block[targets + t])] += block[amplitude + t * waves + k] * feature
        view += _VIEW


@cached_njit(nogil=True, forceinline=True)
def finite(values, width):
    """Return whether all of the first `width` values are numbers."""
    nothing = 0.0
    for i in range(width):
        nothing += values[i] - values[i]
    return nothing == 0.0


@cached_njit(nogil=True, forceinline=True)
def _chance_of(block, view):
    """Return where the counted outcomes of a view are, relative to the block; 0: nowhere."""
    return int(block[int(block[view + _V_GROUP]) + _G_CHANCE])


@cached_njit(nogil=True, forceinline=True)
def _touched(block, action, state):
    """Return whether anything but the file has a say in a step."""
    if block[_AMENDS] == 0.0:
        return False
    table = int(block[_TABLE]) + 2 * action
    views, first = int(block[table]), int(block[table + 1])
    if block[_CHANCY] != 0.0:
        for v in range(views):
            if _chance_of(block, first + v * _VIEW) != 0:
                return True
    for v in range(views):
        view = first + v * _VIEW
        count, group = int(block[view + _V_COUNT]), int(block[view + _V_GROUP])
        mode = mode_of(block, group, int(block[view + _V_INPUTS]), state)
        kinds = int(block[group + _G_KINDS]) + mode * count
        for t in range(count):
            if block[kinds + t] != _FILE:
                return True
    return False


@cached_njit(nogil=True, forceinline=True)
def bend(block, action, state, out, away, kind, shares):
    """Let the likeliest counted outcomes come about, or of one view another one.

    `out` are the fluents after effects, processes and `amend`. Of the view at position `away` (-1:
    of none) the outcome is `kind`. `shares` is room for how likely each outcome is. Returns of how
    many views anything is counted, and the outcome of the last of them, whose shares are left.
    """
    table = int(block[_TABLE]) + 2 * action
    view = int(block[table + 1])
    counted, which = 0, 0
    for v in range(int(block[table])):
        where = _chance_of(block, view)
        if where != 0:
            counted += 1
            chance = advanced(block, where)
            inputs = advanced(block, int(block[view + _V_INPUTS]))
            which = kind
            if v != away:
                which = likeliest(chance, inputs, state, shares)
            if which > 0:
                put(chance, which, inputs, state, out)
        view += _VIEW
    return counted, which


@cached_njit(nogil=True)
def weigh(
    block, action, state, flowed, bent, other, shares, first, flow_flags, dt, unsafe, out
):  # fmt: skip
    """Weigh what else may come of a step than the likeliest: the reward becomes what is expected.

    Views are varied one at a time, and what comes of one is taken to say nothing of the others.
    `flowed` are the fluents after effects, processes and `amend`, `flow_flags` the flags of these;
    `bent` is the likeliest outcome, `out` what events make of it, of which only the reward is
    changed, and `unsafe` whether they flag it. `other` is room for an outcome, `shares` for how
    likely each is. Where one view is all that is counted, `first` is its likeliest outcome and
    `shares` are its own; otherwise `first` is -1. Returns the risk of the step, in [0, 1].
    """
    width = int(block[_WIDTH])
    literals = advanced(block, int(block[_LITERALS]))
    table = int(block[_TABLE]) + 2 * action
    view = int(block[table + 1])
    usual = out[width]
    expected, alike = usual, 1.0
    for _ in range(int(block[table])):
        where = _chance_of(block, view)
        if where != 0:
            chance = advanced(block, where)
            inputs = advanced(block, int(block[view + _V_INPUTS]))
            usually = first if first >= 0 else likeliest(chance, inputs, state, shares)
            different = 0.0
            for kind in range(int(chance[_T_KINDS])):
                p = shares[kind]
                if kind == usually or p <= 0.0:
                    continue
                for i in range(width + 1):
                    other[i] = bent[i]
                take_back(chance, inputs, flowed, other)
                if kind > 0:
                    put(chance, kind, inputs, state, other)
                flags = call_step(int(block[_SETTLE]), state, flow_flags, literals, dt, other)
                undefined = flags & UNDEFINED != 0
                flagged = flags & UNSAFE != 0
                if flagged != unsafe and (flagged or not undefined):
                    different += p
                if not undefined and math.isfinite(other[width]):
                    expected += p * (other[width] - usual)
            alike *= max(0.0, 1.0 - different)
        view += _VIEW
    if math.isfinite(expected):
        out[width] = expected
    return alike if unsafe else 1.0 - alike


@cached_njit(nogil=True, forceinline=True)
def _corrected_step(state, action, block, dt, out):
    revised = block[_REVISED] != 0.0
    if block[_ACTIVE] == 0.0 or not (revised or _touched(block, action, state)):
        return call_step(
            int(block[_STEP]), state, action, advanced(block, int(block[_WRITTEN])), dt, out
        )
    width = int(block[_WIDTH])
    known = revised or block[_JUDGED] != 0.0
    flagged = 0
    if known:
        # What is UNSAFE, the file as written says. With its own literals effects and processes
        # flag the same here as there; only events may not.
        flagged = UNSAFE & call_step(
            int(block[_STEP]), state, action, advanced(block, int(block[_WRITTEN])), dt, out
        )
        for i in range(width):
            out[i] = state[i]
        out[width] = 0.0
    literals = advanced(block, int(block[_LITERALS]))
    flags = call_step(int(block[_FLOW]), state, action, literals, dt, out)
    risk = 0.0
    if flags & APPLICABLE:
        amend(block, action, state, out)
        if not finite(out, width):
            # What leads to no numbers is no correction.
            for i in range(width):
                out[i] = state[i]
            out[width] = 0.0
            flags = call_step(int(block[_FLOW]), state, action, literals, dt, out)
        if block[_CHANCY] == 0.0:
            flags = call_step(int(block[_SETTLE]), state, flags, literals, dt, out)
            risk = 1.0 if flags & UNSAFE else 0.0
        elif _room_for(width) <= STACK:
            flags, risk = _settle_chances(block, action, state, flags, dt, out, stack_room())
        else:
            flags, risk = _settle_many(block, action, state, flags, dt, out)
    if not known:
        flagged = flags & UNSAFE
    flags = flags & ~UNSAFE | flagged
    return _with_risk(flags, risk) if flags & APPLICABLE and not flagged else flags


@cached_njit(nogil=True, forceinline=True)
def _room_for(width):
    return 3 * (width + 1) + _KINDS


@cached_njit(nogil=True)
def _settle_many(block, action, state, flow_flags, dt, out):
    """As `_settle_chances`, of states too long for the stack."""
    room = np.empty(_room_for(int(block[_WIDTH])))
    return _settle_within(block, action, state, flow_flags, dt, out, room)


@cached_njit(nogil=True)
def _settle_within(block, action, state, flow_flags, dt, out, room):
    # Pointers into an array keep it alive only where the array is an argument.
    return _settle_chances(block, action, state, flow_flags, dt, out, pointer_to(room, 0))


@cached_njit(nogil=True)
def _settle_chances(block, action, state, flow_flags, dt, out, room):
    """Let the likeliest outcomes come about, events settle them, and weigh the others.

    Returns:
        Flags of what is likeliest, and the risk of the step.
    """
    width = int(block[_WIDTH])
    literals = advanced(block, int(block[_LITERALS]))
    flowed, bent = room, advanced(room, width + 1)
    other, shares = advanced(room, 2 * (width + 1)), advanced(room, 3 * (width + 1))
    for i in range(width + 1):
        flowed[i] = out[i]
    counted, first = bend(block, action, state, out, -1, 0, shares)
    for i in range(width + 1):
        bent[i] = out[i]
    flags = call_step(int(block[_SETTLE]), state, flow_flags, literals, dt, out)
    unsafe = flags & UNSAFE != 0
    if counted == 0 or not flags & APPLICABLE:
        return flags, 1.0 if unsafe else 0.0
    if counted > 1:
        first = -1
    return flags, weigh(
        block, action, state, flowed, bent, other, shares, first, flow_flags, dt, unsafe, out
    )


def _step(state, action, block, dt, out):
    return _corrected_step(state, action, block, dt, out)


@functools.cache
def corrected_step() -> Any:
    """Return the compiled C callback of a corrected step; its data is a block."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_step)


@cached_njit(nogil=True)
def amend_row(block, action, state, out, away, kind):
    """As `amend`, where that leads to numbers, and then `bend`, on arrays."""
    base, source, target = pointer_to(block, 0), pointer_to(state, 0), pointer_to(out, 0)
    before = out.copy()
    amend(base, action, source, target)
    if not finite(target, state.shape[0]):
        out[:] = before
    if base[_CHANCY] != 0.0:
        shares = np.empty(_KINDS)
        _bend_within(base, action, source, target, away, kind, shares)


@cached_njit(nogil=True)
def shares_row(block, action, state, away):
    """Return `[KINDS]` how likely each outcome of the view at position `away` is, on arrays."""
    base, shares = pointer_to(block, 0), np.zeros(_KINDS)
    view = int(base[int(base[_TABLE]) + 2 * action + 1]) + away * _VIEW
    where = _chance_of(base, view)
    if base[_CHANCY] != 0.0 and where != 0:
        _shares_within(base, where, int(base[view + _V_INPUTS]), pointer_to(state, 0), shares)
    return shares


@cached_njit(nogil=True)
def _shares_within(block, where, inputs, state, shares):
    likeliest(advanced(block, where), advanced(block, inputs), state, pointer_to(shares, 0))


@cached_njit(nogil=True)
def _bend_within(block, action, state, out, away, kind, shares):
    bend(block, action, state, out, away, kind, pointer_to(shares, 0))


@cached_njit(nogil=True)
def step_row(block, action, state, dt, out):
    """Predict the corrected step on arrays; `out` `[F + 1]` begins with the state, then 0."""
    return _corrected_step(
        pointer_to(state, 0), action, pointer_to(block, 0), dt, pointer_to(out, 0)
    )


@cached_njit(nogil=True)
def foresee(block, action, state, dt, rows):
    """Predict one step in four ways.

    Args:
        block: The block, as an array.
        action: Ground action.
        state: `[F]`.
        dt: Control period.
        rows: Flat `[4 · (F + 1)]`; receives the step as the file has it, its effects and processes
            with the literals in use, the same after its events, and the corrected step.

    Returns:
        Flags of the file's step, of the flow and of the corrected step.
    """
    width = state.shape[0]
    row = width + 1
    base, source = pointer_to(block, 0), pointer_to(state, 0)
    for k in range(4):
        for i in range(width):
            rows[k * row + i] = state[i]
        rows[k * row + width] = 0.0
    written = call_step(
        int(base[_STEP]), source, action, advanced(base, int(base[_WRITTEN])), dt,
        pointer_to(rows, 0),
    )  # fmt: skip
    literals = advanced(base, int(base[_LITERALS]))
    flow = call_step(int(base[_FLOW]), source, action, literals, dt, pointer_to(rows, row))
    for i in range(row):
        rows[2 * row + i] = rows[row + i]
    if flow & APPLICABLE:
        call_step(int(base[_SETTLE]), source, flow, literals, dt, pointer_to(rows, 2 * row))
    corrected = _corrected_step(source, action, base, dt, pointer_to(rows, 3 * row))
    return written, flow, corrected


@cached_njit(nogil=True)
def waves_of(x, centre, shrink, frequency, phase, out):
    """Fill `out` with the random features of an input `[d]`, as `amend` computes them."""
    for k in range(phase.shape[0]):
        z = phase[k]
        for i in range(x.shape[0]):
            z += frequency[k, i] * ((x[i] - centre[i]) * shrink[i])
        out[k] = wave(z)
