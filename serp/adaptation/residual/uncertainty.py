"""How certain a prediction is: the predictive standard deviation of the Bayesian regression.

The variance is that of the errors, and besides the posterior variance of the weights: the leverage
of the inputs, times the squared error that was seen where leverage was high.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from serp._util.compilation import cached_cfunc, cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.prediction import features_of, normalise, row_of
from serp.model.native import STACK, STEP_SIGNATURE, advanced, pointer_to, stack_room

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


_PREDICTED = 0.5
"""What the file predicts is known everywhere: typical errors of no more than this part of the
change."""


@cached_njit(nogil=True, forceinline=True)
def leverage(inverse, stride, known, columns, heads, row, head, u, depth, z):
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
        for place in range(3):
            start = 0
            if place == 1:
                start = (1 + head) * block
            elif place == 2:
                if row < heads:
                    break
                start = (1 + row) * block
            if start > i:
                break
            total += inverse[at + start]
            for k in range(min(depth, i - start)):
                total += inverse[at + start + 1 + k] * u[k]
        for k in range(i + 1 - columns):
            total += inverse[at + columns + k] * z[k]
        q += total * total
    return q / (1.0 + q)


@cached_njit(nogil=True)
def uncertainty_of(buffer, action, state, out):
    """Do what `uncertainty` does, with pointers; `out` begins with zeros."""
    table = int(buffer[b.TABLE]) + 2 * action
    group, unknown = int(buffer[table + 1]), 0.0
    u = stack_room(STACK)
    z = advanced(u, r.MAX_INPUTS)
    for _ in range(int(buffer[table])):
        shared = int(buffer[group + b.G_SHARED])
        part = int(buffer[shared + b.S_REGRESSION])
        if part != 0:
            inputs, targets = int(buffer[group + b.G_INPUTS]), int(buffer[group + b.G_TARGETS])
            depth, count = int(buffer[group + b.G_DEPTH]), int(buffer[group + b.G_COUNT])
            head, heads = int(buffer[shared + b.S_HEAD]), int(buffer[part + r.R_HEADS])
            row = row_of(buffer, part, head, inputs, state)
            columns = (1 + int(buffer[part + r.R_ROWS])) * (1 + depth)
            known, kinds = int(buffer[part + r.R_KNOWN]), int(buffer[part + r.R_KINDS])
            most = 0.0
            for t in range(count):
                most = max(most, buffer[kinds + t])
            normalise(buffer, part, inputs, depth, state, u)
            if most <= r.LINEAR:
                known = min(known, columns)
            elif known > columns:
                features_of(
                    advanced(buffer, int(buffer[part + r.R_FREQUENCY])),
                    advanced(buffer, int(buffer[part + r.R_PHASE])), u, depth, 0, z,
                )  # fmt: skip
            inverse = advanced(buffer, int(buffer[part + r.R_INVERSE]))
            share = leverage(
                inverse, columns + r.SMOOTH, known, columns, heads, row, head, u, depth, z
            )
            typical = int(buffer[part + r.R_TYPICAL]) + row * count
            scale = int(buffer[part + r.R_SCALE])
            for t in range(count):
                error, far, change = (
                    buffer[typical + t], buffer[scale + t], buffer[scale + count + t]
                )  # fmt: skip
                written = known > 0 and buffer[kinds + t] == r.FILE
                if not (written and error <= _PREDICTED * change):
                    unknown = max(unknown, share)
                relative = 1.0
                if known > 0:
                    variance = error * error + share * far * far
                    relative = math.sqrt(variance) / change if change > 0.0 else 0.0
                out[int(buffer[targets + t])] = relative
        group += b.GROUP
    return unknown


@cached_njit(nogil=True)
def uncertainty(buffer, action, state, out):
    """Write the predictive standard deviation of each fluent; return the largest leverage.

    The deviations `out` `[F]` are relative to the fluent's typical change: 1 before anything is
    known, 0 for what no residual predicts. The leverage, from 0 to 1, is a distance to data: about
    1 over the number of samples like this one, 1 where there are none; 0 without a regression.

    Args:
        buffer: `AdaptedModel.data`.
        action: Position of the ground action.
        state: `[F]`.
        out: `[F]`, written.
    """
    out[:] = 0.0
    return uncertainty_of(pointer_to(buffer, 0), action, pointer_to(state, 0), pointer_to(out, 0))


def _uncertainty(state, action, buffer, dt, out):
    out[int(buffer[b.WIDTH])] = uncertainty_of(buffer, action, state, out)
    return 0


@functools.cache
def native_uncertainty() -> Any:
    """Return the compiled C callback, see `TransitionModel.native_uncertainty`."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_uncertainty)
