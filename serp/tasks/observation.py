"""Converts observations of an environment to checked vectors."""

from __future__ import annotations

import copy
import inspect
import math
import reprlib
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.errors import TaskError

MOST_COMBINATIONS: Final = 4096
"""Each is an output of the learner's network, and a column of every forecast."""


class ActionSpace:
    """The actions 0 ... size-1 of a discrete space.

    Those of a `MultiDiscrete` or `MultiBinary` space are its combinations, of which the last number
    counts fastest. All are counted from 0, wherever the space begins.

    Raises:
        ValueError: The space is of another kind, or has more than `MOST_COMBINATIONS` combinations.
    """

    def __init__(self, space: Any) -> None:
        self.space = space
        self._shape: tuple[int, ...] | None = None
        if isinstance(space, spaces.Discrete):
            self.size = int(space.n)
            return
        if isinstance(space, spaces.MultiDiscrete):
            self._shape = tuple(space.nvec.ravel().tolist())
        elif isinstance(space, spaces.MultiBinary):
            self._shape = (2,) * int(np.prod(space.shape))
        else:
            raise ValueError(
                f"serp needs discrete actions, this environment has {space}; offer a few "
                "controllers as actions: serp_envs.MacroActions"
            )
        self.size = int(np.prod(self._shape, dtype=object))
        if self.size > MOST_COMBINATIONS:
            raise ValueError(
                f"{space} has {self.size:,} combinations, more than {MOST_COMBINATIONS:,}; "
                "offer those that make sense as a Discrete space, through "
                "gymnasium.wrappers.TransformAction"
            )

    def action(self, number: int) -> Any:
        """Return what the environment's `step` takes for the action with a number."""
        if self._shape is None:
            return int(self.space.start) + number
        places = np.array(np.unravel_index(number, self._shape), dtype=self.space.dtype)
        return places.reshape(self.space.shape) + getattr(self.space, "start", 0)

    def number(self, action: Any) -> Any:
        """Return the number of an action that is given as a sequence of numbers from 0.

        Raises:
            ValueError: The space has no such combination.
        """
        if self._shape is None or not isinstance(action, Sequence | np.ndarray):
            return action  # a number already
        try:
            return int(np.ravel_multi_index(np.array(action).ravel().tolist(), self._shape))
        except (TypeError, ValueError):
            most = ", ".join(str(count - 1) for count in self._shape)
            raise ValueError(f"expected a number, or a tuple from 0 to ({most})") from None


class Observations:
    """The observations of a space, as flat vectors of length `size`.

    Raises:
        ValueError: Observations of the space are not vectors.
    """

    def __init__(self, space: Any) -> None:
        leaves = [(path, leaf, _flattened(leaf)) for path, leaf in _leaf_spaces(space, "")]
        if other := [(path, type(leaf).__name__) for path, leaf, flat in leaves if flat is None]:
            named = ", ".join(f"`{path}` ({kind})" for path, kind in other)
            raise ValueError(
                f"{named if other[0][0] else f'observations of {space}'} cannot be flattened to a "
                "vector of numbers" + _without({path for path, _ in other}, space)
            )
        self.space: spaces.Space[Any] = space
        self.size = sum(flat for _, _, flat in leaves if flat is not None)

    def read(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a new float64 vector `[size]`.

        Raises:
            ValueError: It is not a member of the space, does not consist of real numbers, or is not
                finite; the message names the part, what was given and what is expected.
        """
        parts = [_flat(leaf, value, path) for path, leaf, value in _leaves(self.space, raw, "")]
        vector = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if not np.isfinite(vector).all():
            first = int((~np.isfinite(vector)).argmax())
            raise ValueError(f"{self.name(first)} is {vector[first]}")
        return vector

    def raw(self, vector: NDArray[np.float64]) -> Any:
        """Return the observation of the space for a flat vector."""
        return spaces.unflatten(self.space, vector)

    def name(self, index: int) -> str:
        """Return the name of the entry at a position of the vector."""
        for path, leaf in _leaf_spaces(self.space, ""):
            count = spaces.flatdim(leaf)
            if index < count:
                return _entry(leaf, index) + (f" of `{path}`" if path else "")
            index -= count
        raise IndexError(index)


def _flattened(leaf: Any) -> int | None:
    """Return how many numbers a part has when it is flattened; None where it cannot be."""
    try:
        flat = spaces.flatten_space(leaf)
    except NotImplementedError:
        return None
    return int(flat.shape[0]) if isinstance(flat, spaces.Box) else None


def _without(paths: Collection[str], space: Any) -> str:
    """Say how parts are left out, where they can be."""
    if not isinstance(space, spaces.Dict):
        return ""
    kept = [key for key in space.spaces if not any(p.split(".")[0] == str(key) for p in paths)]
    return f"; keep the others by gymnasium.wrappers.FilterObservation(env, {kept})" if kept else ""


def _entry(leaf: spaces.Space[Any], index: int) -> str:
    if isinstance(leaf, spaces.Box) and len(leaf.shape) != 1:
        place = ", ".join(map(str, np.unravel_index(index, leaf.shape))) if leaf.shape else ""
        return f"entry [{place}]" if place else "the number"
    return f"entry {index}"


def _below(space: Any, path: str) -> list[tuple[Any, str, Any]] | None:
    """Return key, path and space of each part of a composite space, in Gymnasium's order."""
    if isinstance(space, spaces.Dict):
        parts: Any = space.spaces.items()
    elif isinstance(space, spaces.Tuple):
        parts = enumerate(space.spaces)
    else:
        return None
    return [(key, f"{path}.{key}" if path else str(key), part) for key, part in parts]


def _leaf_spaces(space: Any, path: str) -> Iterator[tuple[str, Any]]:
    below = _below(space, path)
    if below is None:
        yield path, space
        return
    for _, place, part in below:
        yield from _leaf_spaces(part, place)


def _leaves(space: Any, raw: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield path, space and value of every part that is not composite."""
    below = _below(space, path)
    if below is None:
        yield path, space, raw
        return
    kind = Mapping if isinstance(space, spaces.Dict) else Sequence
    if not isinstance(raw, kind) or isinstance(raw, str) or len(raw) != len(below):
        raise ValueError(f"{_named(path, raw)}; {space} is wanted")
    for key, place, part in below:
        if isinstance(raw, Mapping) and key not in raw:
            raise ValueError(f"{_named(path, raw)}, without `{key}`; {space} is wanted")
        yield from _leaves(part, raw[key], place)


def _flat(leaf: spaces.Space[Any], value: Any, path: str) -> NDArray[np.float64]:
    if not isinstance(leaf, spaces.Box):
        if not leaf.contains(value):
            raise ValueError(f"{_named(path, value)}; a member of {leaf} is wanted")
        return np.asarray(spaces.flatten(leaf, value), dtype=np.float64).reshape(-1)
    try:
        array = np.asarray(value)
    except Exception as error:  # ragged lists, a tensor with a gradient, or anything else
        raise ValueError(f"{_named(path, value)}, which is not an array: {error}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{_named(path, value)}; real numbers are wanted, for {leaf}")
    size = math.prod(leaf.shape)
    if array.size != size:
        raise ValueError(
            f"{_named(path, value)}: {array.size} numbers of shape {array.shape}; "
            f"{size} are wanted, for {leaf}"
        )
    return np.array(array, dtype=np.float64).reshape(-1)  # environments reuse their buffers


def _named(path: str, value: Any) -> str:
    part = f"`{path}` is " if path else ""
    return f"{part}{reprlib.repr(value)} ({type(value).__name__})"


FAR = 1e9
"""Replaces an infinite bound of a space."""
_MORE: Final = ("info", "env")
"""What a grounding may take beside the observation, by the names of its parameters."""


class Grounding:
    """The grounding function of a task, called with what its parameters name.

    Attributes:
        takes: Which of `info` and `env` the function takes beside the observation.

    Raises:
        TaskError: The function cannot be called with an observation and these.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        try:
            signature = inspect.signature(function)
        except (TypeError, ValueError):  # some callables written in C have no signature
            self.takes: tuple[str, ...] = ()
            return
        self.takes = tuple(name for name in _MORE if name in list(signature.parameters)[1:])
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
        given = {"info": info, "env": env}
        return self._function(observation, **{name: given[name] for name in self.takes})

    def missing(self, info: Mapping[str, Any] | None, env: gym.Env[Any, Any] | None) -> str | None:
        """Return the name of what the function takes and is not given; None for none."""
        given = {"info": info, "env": env}
        return next((name for name in self.takes if given[name] is None), None)

    def on_samples(self, space: spaces.Space[Any], count: int) -> Iterator[Any]:
        """Yield the results on sampled observations, except those on which the function fails.

        An environment need not give every observation of its space. Nothing is yielded for a
        function that takes more than the observation, of which there are no samples.
        """
        if self.takes:
            return
        for observation in samples(space, count):
            try:
                with warnings.catch_warnings(), np.errstate(all="ignore"):
                    warnings.simplefilter("ignore")
                    given = self(observation)
            except Exception:
                continue
            yield given


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
