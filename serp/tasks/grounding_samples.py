"""Results of a task's grounding on sampled observations; the environment is not used."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

FAR = 1e9
"""Replaces an infinite bound of a space."""


def samples(space: spaces.Space[Any], count: int) -> Iterator[Any]:
    """Yield observations of a space; of a box first its centre and bounds, then random points.

    The space's random generator is not used. Equal calls yield equal observations, `count` of them
    random.
    """
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating):
        low = np.clip(space.low.astype(np.float64), -FAR, FAR)
        high = np.clip(space.high.astype(np.float64), -FAR, FAR)
        for point in _of_box(low, high, count):
            yield np.clip(point.astype(space.dtype), space.low, space.high)
        return
    try:
        own = copy.deepcopy(space)
        own.seed(0)
        for _ in range(count):
            yield own.sample()
    except Exception:  # a custom space that cannot be sampled
        return


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
    """Yield the results of a grounding on sampled observations, except those on which it fails.

    An environment need not give every observation of its space.
    """
    for observation in samples(space, count):
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                given = ground(observation)
        except Exception:
            continue
        yield given
