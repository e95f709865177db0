"""Converts observations of an environment to checked vectors."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray


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
