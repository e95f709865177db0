"""The parts of the file's step with the parameters in use: effects and processes, then events.

`buffer` is the memory of `serp.model.learned.parameter_buffer`, a pointer unless said otherwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE
from serp.model.learned import parameter_buffer as b
from serp.model.native import advanced, call_step, pointer_to
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True, forceinline=True)
def flow(buffer, action, state, dt, out):
    """Write the state after effects and processes, and the reward, to `out`; return the flags."""
    for i in range(int(buffer[b.WIDTH])):
        out[i] = state[i]
    out[int(buffer[b.WIDTH])] = 0.0
    parameters = advanced(buffer, int(buffer[b.PARAMETERS]))
    return call_step(int(buffer[b.FLOW]), state, action, parameters, dt, out)


@cached_njit(nogil=True, forceinline=True)
def settle(buffer, state, flags, dt, out):
    """Apply events to `out`, a step that has such flags so far; return the flags."""
    parameters = advanced(buffer, int(buffer[b.PARAMETERS]))
    return call_step(int(buffer[b.SETTLE]), state, flags, parameters, dt, out)


@cached_njit(nogil=True)
def _flow_and_settle(buffer, action, state, dt, flowed, settled):
    base, source = pointer_to(buffer, 0), pointer_to(state, 0)
    flags = flow(base, action, source, dt, pointer_to(flowed, 0))
    settled[:] = flowed
    if flags & APPLICABLE:
        settle(base, source, flags, dt, pointer_to(settled, 0))
    return flags


class ObservedStep(NamedTuple):
    """An observed transition, beside what the file says of it.

    Attributes:
        state, action, next_state: The transition; states are `[F]`.
        over: Whether it ended the episode.
        flowed: `[F + 1]` state and reward after effects and processes.
        settled: `[F + 1]` the same after events.
        flags: Flags of the former.
    """

    state: Vector
    action: int
    next_state: Vector
    over: bool
    flowed: Vector
    settled: Vector
    flags: int


def observed_step(
    buffer: Vector, dt: float, state: Vector, action: int, next_state: Vector, over: bool
) -> ObservedStep | None:
    """Return a transition to learn from; None if its action is not applicable by the file.

    `buffer` is an array.
    """
    flowed, settled = np.empty((2, len(state) + 1))
    flags = int(_flow_and_settle(buffer, action, state, dt, flowed, settled))
    if not flags & APPLICABLE:
        return None
    return ObservedStep(state, action, next_state, over, flowed, settled, flags)
