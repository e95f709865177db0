"""What an environment takes and gives: actions, observations, and the answers of its methods."""

from __future__ import annotations

import copy
import math
import reprlib
from collections import OrderedDict
from collections.abc import Collection, Iterator, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.errors import EnvironmentFailure, TaskError


class ActionSpace:
    """The actions 0 ... size-1 of a discrete space.

    Those of a `MultiDiscrete` or `MultiBinary` space are its combinations, of which the last number
    counts fastest. All are counted from 0, wherever the space begins.

    Raises:
        ValueError: The space is of another kind, or has more than 4,096 combinations.
    """

    def __init__(self, space: Any) -> None:
        most = 4096  # each is an output of the learner's network, and a column of every forecast
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
                f"serp needs discrete actions, but this environment has {space}; offer a few "
                "controllers as actions: serp_envs.MacroActions"
            )
        self.size = int(np.prod(self._shape, dtype=object))
        if self.size > most:
            raise ValueError(
                f"{space} has {self.size:,} combinations, more than {most:,}; "
                "offer the useful ones as a Discrete space, with "
                "gymnasium.wrappers.TransformAction"
            )

    def action(self, number: int) -> Any:
        """Return what the environment's `step` takes for the action with a number."""
        if self._shape is None:
            return int(self.space.start) + number
        places = np.array(np.unravel_index(number, self._shape), dtype=self.space.dtype)
        return places.reshape(self.space.shape) + getattr(self.space, "start", 0)

    def number(self, action: Any) -> Any:
        """Return the number of an action, also of one that is a sequence of numbers from 0."""
        if self._shape is None or not isinstance(action, Sequence | np.ndarray):
            return action  # a number already
        try:
            return int(np.ravel_multi_index(np.array(action).ravel().tolist(), self._shape))
        except (TypeError, ValueError):
            most = ", ".join(str(count - 1) for count in self._shape)
            raise ValueError(f"expected a number, or a tuple of at most ({most})") from None


class Observations:
    """The observations of a space, as flat vectors of length `size`; else a ValueError.

    Texts are left out.
    """

    def __init__(self, space: Any) -> None:
        sizes = {path: _flat_size(leaf) for path, leaf in _leaf_spaces(space, "")}
        if odd := [path for path, size in sizes.items() if size is None]:
            named = ", ".join(f"`{path}`" for path in odd if path) or f"observations of {space}"
            raise ValueError(
                f"{named} cannot be flattened to a vector of numbers{_without(odd, space)}"
            )
        self.space: spaces.Space[Any] = space
        self.size = sum(size or 0 for size in sizes.values())
        self._one_box = isinstance(space, spaces.Box)

    def read(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a new float64 vector `[size]`.

        Raises:
            ValueError: It is not a member of the space, does not consist of real numbers, or is not
                finite; the message names the part, what was given and what is expected.
        """
        if self._one_box:
            vector = _flat(self.space, raw, "")
        else:
            leaves = _leaves(self.space, raw, "")
            vector = np.concatenate([_flat(leaf, value, path) for path, leaf, value in leaves])
        finite = np.isfinite(vector)
        if np.count_nonzero(finite) < len(finite):  # `all` takes five times as long
            first = int(finite.argmin())
            raise ValueError(f"{self.name(first)} is {vector[first]}")
        return vector

    def name(self, index: int) -> str:
        """Return the name of the entry at a position of the vector."""
        for path, leaf in _leaf_spaces(self.space, ""):
            count = spaces.flatdim(leaf)
            if index < count:
                return _entry(leaf, index, path)
            index -= count
        raise IndexError(index)


def described(space: Any) -> dict[str, Any]:
    """Return a space of observations as values for `json_text`, or raise a TaskError.

    Bounds of a `Box` are left out, because its observations may lie outside of them.
    """
    if (below := _below(space, "")) is not None:
        parts = {key: described(part) for key, _, part in below}
        return {"Dict": parts} if isinstance(space, spaces.Dict) else {"Tuple": [*parts.values()]}
    if is_text(space):
        return {"Text": {"max_length": 1}}
    for kind, names in _DESCRIBED.items():
        if isinstance(space, getattr(spaces, kind)):
            return {kind: {name: getattr(space, name) for name in names}}
    raise TaskError(f"observations of {space} are not exported: it is not a space of Gymnasium")


def space_of(description: Mapping[str, Any], most: int) -> spaces.Space[Any]:
    """Return the space that `described` describes, with at most so many entries.

    Raises a ValueError, TypeError or KeyError for what `described` does not return.
    """
    ((kind, given),) = description.items()
    if kind == "Dict":  # which would sort the keys of another mapping
        parts = ((str(key), space_of(part, most)) for key, part in given.items())
        return spaces.Dict(OrderedDict(parts))
    if kind == "Tuple":
        return spaces.Tuple([space_of(part, most) for part in given])
    if kind not in _DESCRIBED and kind != "Text":
        raise ValueError(f"there is no space `{kind}`")
    if math.prod(np.ravel(given.get("shape", given.get("n", 1))).tolist()) > most:
        raise ValueError(f"a space has more than {most:,} entries")
    if kind == "Box":
        unlike, of = {"f": (-np.inf, np.inf), "b": (0, 1)}, np.dtype(given["dtype"])
        low, high = unlike.get(of.kind) or (np.iinfo(of).min, np.iinfo(of).max)
        given = {"low": low, "high": high, **given}
    made: spaces.Space[Any] = getattr(spaces, kind)(**given)
    return made


_DESCRIBED = {"Box": ("shape", "dtype"), "Discrete": ("n", "start"),
              "MultiDiscrete": ("nvec", "start"), "MultiBinary": ("n",)}  # fmt: skip


def is_text(space: Any) -> bool:
    """Return whether the members of a space are texts."""
    return getattr(getattr(space, "dtype", None), "kind", "") == "U"


def _flat_size(leaf: Any) -> int | None:
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
    return f"; keep the rest with gymnasium.wrappers.FilterObservation(env, {kept})" if kept else ""


def _entry(leaf: spaces.Space[Any], index: int, path: str) -> str:
    if isinstance(leaf, spaces.Discrete):
        return f"{path or 'observation'} = {leaf.start + index}"
    if isinstance(leaf, spaces.MultiDiscrete):
        ends = np.cumsum(leaf.nvec)
        at = np.unravel_index(k := int(np.searchsorted(ends, index, "right")), leaf.shape)
        value = index - ends[k] + leaf.nvec[at] + leaf.start[at]
        return f"{path or 'observation'}[{', '.join(map(str, at))}] = {value}"
    place = str(index)
    if isinstance(leaf, spaces.Box) and len(leaf.shape) != 1:
        place = f"[{', '.join(map(str, np.unravel_index(index, leaf.shape)))}]"
    named = f"entry {place}" if leaf.shape else "the number"
    return f"{named} of `{path}`" if path else named


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
        if not is_text(space):
            yield path, space
        return
    for _, place, part in below:
        yield from _leaf_spaces(part, place)


def _leaves(space: Any, raw: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield path, space and value of every part that is not composite."""
    below = _below(space, path)
    if below is None:
        if not is_text(space):
            yield path, space, raw
        return
    kind = Mapping if isinstance(space, spaces.Dict) else Sequence
    if not isinstance(raw, kind) or isinstance(raw, str) or len(raw) != len(below):
        raise ValueError(f"{_named(path, raw)}; expected {space}")
    for key, place, part in below:
        if isinstance(raw, Mapping) and key not in raw:
            raise ValueError(f"{_named(path, raw)}, without `{key}`; expected {space}")
        yield from _leaves(part, raw[key], place)


def _flat(leaf: spaces.Space[Any], value: Any, path: str) -> NDArray[np.float64]:
    if not isinstance(leaf, spaces.Box):
        if not leaf.contains(value):
            raise ValueError(f"{_named(path, value)}; expected a member of {leaf}")
        return np.asarray(spaces.flatten(leaf, value), dtype=np.float64).reshape(-1)
    try:
        array = np.asarray(value)
    except Exception as error:  # ragged lists, a tensor with a gradient, or anything else
        raise ValueError(f"{_named(path, value)}, which is not an array: {error}") from None
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{_named(path, value)}; expected real numbers for {leaf}")
    size = math.prod(leaf.shape)
    if array.size != size:
        raise ValueError(
            f"{_named(path, value)}: {array.size} numbers of shape {array.shape}; "
            f"expected {size} for {leaf}"
        )
    return np.array(array, dtype=np.float64).reshape(-1)  # environments reuse their buffers


def _named(path: str, value: Any) -> str:
    return (f"`{path}` is " if path else "") + _shown(value)


def _shown(value: Any) -> str:
    return f"{reprlib.repr(value)} ({type(value).__name__})"


# Answers of `reset` and `step`: an EnvironmentFailure says what was returned and what is expected.


def step_answer(answer: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
    """Return observation, reward, terminated, truncated and info, copied.

    The reward must be finite; reward, terminated and truncated may be arrays of one element.
    """
    wanted = "the five values (observation, reward, terminated, truncated, info)"
    raw, reward, terminated, truncated, info = _parts(answer, 5, wanted)
    return (
        _copied(raw),
        _number(reward, "the reward"),
        _truth(terminated, "terminated"),
        _truth(truncated, "truncated"),
        _info(info),
    )


def reset_answer(answer: Any) -> tuple[Any, dict[str, Any]]:
    """Return observation and info, copied."""
    raw, info = _parts(answer, 2, "the two values (observation, info)")
    return _copied(raw), _info(info)


def _parts(answer: Any, count: int, wanted: str) -> tuple[Any, ...]:
    if isinstance(answer, tuple | list) and len(answer) == count:
        return tuple(answer)
    returned = f"{len(answer)} values" if isinstance(answer, tuple | list) else _shown(answer)
    raise EnvironmentFailure(f"it returned {returned}, not {wanted}")


def _copied(raw: Any) -> Any:
    """Return a copy of an observation, because environments reuse their buffers."""
    if type(raw) is np.ndarray and raw.dtype.kind in "biuf":
        return raw.copy()
    return copy.deepcopy(raw) if isinstance(raw, np.ndarray | Mapping | tuple | list) else raw


def _number(value: Any, what: str) -> float:
    if type(value) is float and math.isfinite(value):
        return value
    element = single(value)
    if not isinstance(element, Real):
        advice = ""
        if getattr(element, "shape", ()):
            advice = "; combine its parts in a wrapper, such as gymnasium.wrappers.TransformReward"
        raise EnvironmentFailure(f"{what} is {_shown(value)}, not one number{advice}")
    try:
        number = float(element)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise EnvironmentFailure(f"{what} is {number}, not a finite number")
    return number


def _truth(value: Any, what: str) -> bool:
    if type(value) is bool:
        return value
    element = single(value)
    if isinstance(element, Real) and element in (0, 1):
        return bool(element)
    raise EnvironmentFailure(f"{what} is {_shown(value)}, not True or False")


def _info(value: Any) -> dict[str, Any]:
    if type(value) is not dict and not isinstance(value, Mapping):
        raise EnvironmentFailure(f"info is {_shown(value)}, not a dictionary")
    if "unsafe" in value:  # harm must not pass because of how it is written
        return {**value, "unsafe": _truth(value["unsafe"], 'info["unsafe"]')}
    return dict(value)


def single(value: Any) -> Any:
    """Return the only element of an array, a tensor or a NumPy scalar; else the value itself."""
    if isinstance(value, bool | int | float) or not hasattr(value, "__array__"):
        return value
    try:
        array = np.asarray(value)
    except Exception:  # a tensor with a gradient refuses, and others may raise anything
        return value
    return array.item() if array.size == 1 else value
