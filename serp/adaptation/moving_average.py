"""The rate of moving averages: a plain mean of a few samples at first, later an exponential one."""

from __future__ import annotations

from serp._util.compilation import cached_njit

_EARLY = 3.0
"""The n-th sample has the weight 3 / (2 + n) at first: early samples are soon forgotten."""


@cached_njit(nogil=True)
def rate_of(samples, memory):  # type: ignore[no-untyped-def]
    """Return the weight of the next sample in a moving average.

    Args:
        samples: How many there were before it.
        memory: Weight of the past in the long run, a step.
    """
    return max(1.0 - memory, _EARLY / (_EARLY + samples))
