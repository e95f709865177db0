"""Detection of unusable observations; the same loops for every domain."""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

HUGE = 1e60
"""Numbers of at least this size are not used; sums of their squares would overflow."""
FEW, SETTLED = 5, 30
"""Samples before which nothing counts as an outlier, and before which only `EXTREME` errors do."""
FAR, EXTREME = 8.0, 100.0
"""An outlier is off by this many typical errors, or half ranges of an input."""
PATIENCE = 3
"""After more successive outliers than this the environment is assumed to have changed."""


@cached_njit(nogil=True)
def update_whole(state, next_state, numeric, whole):
    """Update which fluents were always `whole` `[F]`; return whether none is NaN or huge."""
    for i in range(state.shape[0]):
        if not (abs(state[i]) < HUGE and abs(next_state[i]) < HUGE):
            return False
    for i in range(state.shape[0]):
        if numeric[i] and next_state[i] != np.floor(next_state[i]):
            whole[i] = False
    return True


@cached_njit(nogil=True)
def far_off(x, low, high, limit):
    """Return whether an input `[d]` is more than `limit` half ranges from the middle of its range.

    An input that never changed has a half range of 1.
    """
    for i in range(x.shape[0]):
        centre, half = (high[i] + low[i]) / 2, (high[i] - low[i]) / 2
        if half <= 1e-9 * max(1.0, abs(centre)):
            half = 1.0
        if abs(x[i] - centre) > limit * half:
            return True
    return False
