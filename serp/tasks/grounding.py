"""The grounding of a task: from an observation to the value of every fluent."""

from __future__ import annotations

import copy
import inspect
import itertools
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from serp.errors import TaskError

FAR = 1e9
"""Replaces an infinite bound of a space."""


class Grounding:
    """The grounding function of a task, called with what its parameters name.

    It takes an observation, and beside it those of `info` and `env` that are in `takes`.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        try:
            signature = inspect.signature(function)
        except (TypeError, ValueError):  # some callables written in C have no signature
            self.takes: tuple[str, ...] = ()
            return
        self.takes = tuple(k for k in ("info", "env") if k in list(signature.parameters)[1:])
        try:
            signature.bind(None, **dict.fromkeys(self.takes))
        except TypeError as error:
            raise TaskError(
                f"ground{signature} cannot be called: {error}; its parameters must be the "
                "observation and, if needed, `info` and `env`: ground(observation, info, env)"
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
        taken = {name: beside[name] for name in self.takes}
        for name, given in taken.items():
            if given is None:
                raise TaskError(
                    f"the grounding needs `{name}` as well as the observation; give both"
                )
        return self._function(observation, **taken)

    def on_samples(self, space: spaces.Space[Any], count: int) -> Iterator[Any]:
        """Yield the results on sampled observations alone, except where the function fails."""
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

    Of whole numbers, the least and the largest, and random ones.

    Equal calls yield equal observations; the space's own random generator is not used.
    """
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating):
        low = np.clip(space.low.astype(np.float64), -FAR, FAR)
        high = np.clip(space.high.astype(np.float64), -FAR, FAR)
        middle, points = (low + high) / 2, []
        if low.size <= count:
            for index in np.ndindex(low.shape):
                for bound in (low, high):
                    points.append(middle.copy())
                    points[-1][index] = bound[index]
        random = np.random.default_rng(0)
        drawn = (random.uniform(low, high) for _ in range(count))
        for point in itertools.chain((middle, low, high), points, drawn):
            yield np.clip(point.astype(space.dtype), space.low, space.high)
        return
    if isinstance(space, spaces.MultiDiscrete):
        yield from (space.start.copy(), space.start + space.nvec - 1)
    try:
        own = copy.deepcopy(space)
        own.seed(0)
        for _ in range(count):
            yield own.sample()
    except Exception:  # a custom space that cannot be sampled
        return
