"""How fast means of late forget: hardly anything at first, later all but a fixed share."""

from __future__ import annotations

from serp._util.compilation import cached_njit

_EARLY = 3.0
"""At first all but this share's part of the samples is forgotten."""


@cached_njit(nogil=True)
def rate_of(samples, memory):  # type: ignore[no-untyped-def]
    """Return the weight of the next sample in a decayed mean.

    Args:
        samples: How many there were before it.
        memory: Weight of the past in the long run, a step.
    """
    return max(1.0 - memory, _EARLY / (_EARLY + samples))
