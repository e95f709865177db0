"""The grounding of a task: from an observation to the value of every fluent."""

from __future__ import annotations

import copy
import inspect
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.errors import TaskError

FAR = 1e9
"""Replaces an infinite bound of a space."""


class Grounding:
    """The grounding function of a task, called with what its parameters name.

    Attributes:
        takes: Which of `info` and `env` the function takes beside the observation.

    Raises:
        TaskError: The function cannot be called with an observation and these.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        # What a grounding may take beside the observation, by the names of its parameters.
        beside = ("info", "env")
        self._function = function
        try:
            signature = inspect.signature(function)
        except (TypeError, ValueError):  # some callables written in C have no signature
            self.takes: tuple[str, ...] = ()
            return
        self.takes = tuple(name for name in beside if name in list(signature.parameters)[1:])
        try:
            signature.bind(None, **dict.fromkeys(self.takes))
        except TypeError as error:
            raise TaskError(
                f"ground{signature} cannot be called: {error}; let it take the observation, and "
                "beside it what it needs of `info` and `env`: ground(observation, info, env)"
            ) from None

    def __call__(
        self,
        observation: Any,
        info: Mapping[str, Any] | None = None,
        env: gym.Env[Any, Any] | None = None,
    ) -> Any:
        """Return what the function returns for an observation and what came with it."""
        if not self.takes:
            return self._function(observation)
        beside = {"info": info, "env": env}
        return self._function(observation, **{name: beside[name] for name in self.takes})

    def missing(self, info: Mapping[str, Any] | None, env: gym.Env[Any, Any] | None) -> str | None:
        """Return the name of what the function takes and is not given; None for none."""
        beside = {"info": info, "env": env}
        return next((name for name in self.takes if beside[name] is None), None)

    def on_samples(self, space: spaces.Space[Any], count: int) -> Iterator[Any]:
        """Yield the results on sampled observations, except those on which the function fails.

        Nothing is yielded for a function that takes more than the observation.
        """
        if self.takes:
            return
        for observation in samples(space, count):
            try:
                with warnings.catch_warnings(), np.errstate(all="ignore"):
                    warnings.simplefilter("ignore")
                    grounded = self(observation)
            except Exception:
                continue
            yield grounded


def samples(space: spaces.Space[Any], count: int) -> Iterator[Any]:
    """Yield observations of a space: of a box its centre, its bounds and `count` random points.

    Equal calls yield equal observations; the space's own random generator is not used.
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
