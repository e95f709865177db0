"""The rate of moving averages: nearly a plain mean at first, later an exponential one."""

from __future__ import annotations

from serp._util.compilation import cached_njit

_EARLY = 3.0
"""The n-th sample initially has the weight 3 / (2 + n), so that early samples soon lose weight."""


@cached_njit(nogil=True)
def rate_of(samples, memory):  # type: ignore[no-untyped-def]
    """Return the weight of the next sample; `memory` is that of the past in the long run."""
    return max(1.0 - memory, _EARLY / (_EARLY + samples))
