"""Which observations are believed at all; the same loops for every domain."""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

HUGE = 1e60
"""Numbers from here on are no observations; sums of their squares would overflow."""


@cached_njit(nogil=True)
def note_whole(state, next_state, numeric, whole):
    """Note which numbers are not whole; return whether all are numbers within bounds.

    Args:
        state: `[F]` before a step.
        next_state: `[F]` observed after it.
        numeric: `[F]` which fluents are no predicates.
        whole: `[F]` which were always whole; changed in place where nothing is beyond bounds.
    """
    for i in range(state.shape[0]):
        if not (abs(state[i]) < HUGE and abs(next_state[i]) < HUGE):
            return False
    for i in range(state.shape[0]):
        if numeric[i] and next_state[i] != np.floor(next_state[i]):
            whole[i] = False
    return True


@cached_njit(nogil=True)
def far_off(x, low, high, limit):
    """Return whether an input is more than `limit` half ranges off the middle of its range.

    Args:
        x: `[d]` inputs.
        low: `[d]` least that they were.
        high: `[d]` most that they were.
        limit: See above. What never changed counts as if it had a half range of 1.
    """
    for i in range(x.shape[0]):
        centre, half = (high[i] + low[i]) / 2, (high[i] - low[i]) / 2
        if half <= 1e-9 * max(1.0, abs(centre)):
            half = 1.0
        if abs(x[i] - centre) > limit * half:
            return True
    return False
