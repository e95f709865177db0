"""How far a step is from the data that a model was adapted to."""

from __future__ import annotations

import functools
from typing import Any

from serp._util.compilation import cached_cfunc, cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.features import normalise, row_of
from serp.adaptation.residual.leverage import leverage_at
from serp.model.native import STACK, STEP_SIGNATURE, advanced, pointer_to, stack_room

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_PREDICTED = 0.5
"""What the file predicts is known everywhere: typical errors of no more than this part of the
change."""


@cached_njit(nogil=True)
def uncertainty_of(buffer, action, state):
    """Return the largest leverage of what the file does not predict; all are pointers."""
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
            row = row_of(buffer, part, head, inputs, state)
            known, kinds = int(buffer[part + r.R_KNOWN]), int(buffer[part + r.R_KINDS])
            rows, typical = int(buffer[part + r.R_ROWS]), int(buffer[part + r.R_TYPICAL])
            change = int(buffer[part + r.R_SCALE]) + count
            most, written = 0.0, known > 0
            for t in range(count):
                most = max(most, buffer[kinds + t])
                for each in range(rows):  # a row without samples says nothing of the file
                    if buffer[typical + each * count + t] > _PREDICTED * buffer[change + t]:
                        written = False
            if not (written and most == r.FILE):
                normalise(buffer, part, inputs, depth, state, u)
                unknown = max(unknown, leverage_at(buffer, part, row, head, most, u, depth, z))
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
