"""What a task's grounding gives, looked at before anything is done in the environment.

The grounding is a function of an observation, so observations that the space allows tell which
fluents it gives; the environment is neither reset nor stepped.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

FAR = 1e9
"""What stands for a bound that a space leaves open."""


def samples(space: spaces.Space[Any], count: int) -> Iterator[Any]:
    """Yield observations of a space: of a box its corners and edges first, then random ones.

    The space's own random numbers are left alone. Equal calls yield equal observations.

    Args:
        space: The observation space.
        count: How many random ones.
    """
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating):
        low = np.clip(space.low.astype(np.float64), -FAR, FAR)
        high = np.clip(space.high.astype(np.float64), -FAR, FAR)
        yield from (_inside(space, point) for point in _of_box(low, high, count))
        return
    try:
        own = copy.deepcopy(space)
        own.seed(0)
        for _ in range(count):
            yield own.sample()
    except Exception:  # a space of one's own that cannot be sampled
        return


def _inside(space: spaces.Box, point: NDArray[np.float64]) -> Any:
    """Return a point as the environment would give it."""
    return np.clip(point.astype(space.dtype), space.low, space.high)


def _of_box(
    low: NDArray[np.float64], high: NDArray[np.float64], count: int
) -> Iterator[NDArray[np.float64]]:
    middle = (low + high) / 2
    yield from (middle, low, high)
    if low.size <= count:
        for index in np.ndindex(low.shape):
            for bound in (low, high):
                point = middle.copy()
                point[index] = bound[index]
                yield point
    random = np.random.default_rng(0)
    for _ in range(count):
        yield random.uniform(low, high)


def grounded(ground: Callable[[Any], Any], space: spaces.Space[Any], count: int) -> Iterator[Any]:
    """Yield what a grounding makes of observations; those on which it fails are left out.

    An observation that the space allows need not be one that ever comes.
    """
    for observation in samples(space, count):
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                given = ground(observation)
        except Exception:
            continue
        yield given
