"""How far a step is from the data that a model was adapted to."""

from __future__ import annotations

import functools
from typing import Any

from serp._util.compilation import cached_cfunc, cached_njit
from serp.model.learned import parameter_buffer as b
from serp.model.learned import residual_features as r
from serp.model.learned.residual_features import (
    dot_chunk,
    features_of,
    linear_of,
    normalise,
)
from serp.model.native import STACK, STEP_SIGNATURE, advanced, pointer_to, stack_room
from serp.model.transition_model import UNKNOWN

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


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
