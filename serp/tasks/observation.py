"""Converts observations of an environment to checked vectors."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

_SLACK: Final = 1e-6
"""Tolerance relative to a bound, because float32 rounds."""


class OutOfBounds(NamedTuple):
    """A number outside the bounds that its space declares.

    Attributes:
        name: Name of the entry.
        value: Its value.
        bound: The bound that it exceeds.
    """

    name: str
    value: float
    bound: float


class Observations:
    """The observations of a space, as flat vectors.

    Args:
        space: The space.

    Attributes:
        size: Length of the vectors.

    Raises:
        ValueError: Observations of the space are not vectors.
    """

    def __init__(self, space: Any) -> None:
        try:
            flat = spaces.flatten_space(space)
        except NotImplementedError:
            flat = None
        if not isinstance(flat, spaces.Box):
            raise ValueError(f"observations of {space} cannot be flattened to a vector")
        self.space: spaces.Space[Any] = space
        self.size = int(flat.shape[0])
        low, high = flat.low.astype(np.float64), flat.high.astype(np.float64)
        self._low = low - _SLACK * np.abs(np.where(np.isfinite(low), low, 0.0))
        self._high = high + _SLACK * np.abs(np.where(np.isfinite(high), high, 0.0))
        self._bounded = bool(np.isfinite(low).any() or np.isfinite(high).any())

    def read(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a new float64 vector `[size]`.

        Raises:
            ValueError: It is not a member of the space, does not consist of real numbers, or is not
                finite; the message names the part, what was given and what is expected.
        """
        if isinstance(self.space, spaces.Box):
            vector = _flat(self.space, raw, "")
        else:
            parts = [_flat(leaf, value, path) for path, leaf, value in _leaves(self.space, raw, "")]
            vector = np.concatenate(parts)
        if not np.isfinite(vector).all():
            first = int((~np.isfinite(vector)).argmax())
            raise ValueError(f"{self.name(first)} is {vector[first]}")
        return vector

    def raw(self, vector: NDArray[np.float64]) -> Any:
        """Return the observation of the space for a flat vector."""
        if isinstance(self.space, spaces.Box):
            return vector.reshape(self.space.shape).astype(self.space.dtype)
        return spaces.unflatten(self.space, vector)

    def outside(self, vector: NDArray[np.float64]) -> OutOfBounds | None:
        """Return the first number outside the declared bounds; None if all are inside."""
        if not self._bounded:
            return None
        low, high = vector < self._low, vector > self._high
        wrong = low | high
        if not wrong.any():
            return None
        k = int(wrong.argmax())
        return OutOfBounds(
            self.name(k), float(vector[k]), float((self._low if low[k] else self._high)[k])
        )

    def name(self, index: int) -> str:
        """Return the name of the entry at a position of the vector."""
        for path, leaf in _leaf_spaces(self.space, ""):
            count = spaces.flatdim(leaf)
            if index < count:
                return _entry(leaf, index) + (f" of `{path}`" if path else "")
            index -= count
        raise IndexError(index)


def _entry(leaf: spaces.Space[Any], index: int) -> str:
    if isinstance(leaf, spaces.Box) and len(leaf.shape) != 1:
        place = ", ".join(map(str, np.unravel_index(index, leaf.shape))) if leaf.shape else ""
        return f"entry [{place}]" if place else "the number"
    return f"entry {index}"


def _below(space: Any) -> list[tuple[Any, Any]] | None:
    """Return key and space of each part of a composite space, in Gymnasium's order."""
    if isinstance(space, spaces.Dict):
        return list(space.spaces.items())
    if isinstance(space, spaces.Tuple):
        return list(enumerate(space.spaces))
    return None


def _leaf_spaces(space: Any, path: str) -> Iterator[tuple[str, Any]]:
    below = _below(space)
    if below is None:
        yield path, space
        return
    for key, part in below:
        yield from _leaf_spaces(part, f"{path}.{key}" if path else str(key))


def _leaves(space: Any, raw: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield path, space and value of every part that is not composite."""
    below = _below(space)
    if below is None:
        yield path, space, raw
        return
    kind = Mapping if isinstance(space, spaces.Dict) else Sequence
    if not isinstance(raw, kind) or isinstance(raw, str) or len(raw) != len(below):
        raise ValueError(f"{_named(path, raw)}; {space} is wanted")
    for key, part in below:
        if isinstance(raw, Mapping) and key not in raw:
            raise ValueError(f"{_named(path, raw)}, without `{key}`; {space} is wanted")
        yield from _leaves(part, raw[key], f"{path}.{key}" if path else str(key))


def _flat(leaf: spaces.Space[Any], value: Any, path: str) -> NDArray[np.float64]:
    if not isinstance(leaf, spaces.Box):
        if not leaf.contains(value):
            raise ValueError(f"{_named(path, value)}; a member of {leaf} is wanted")
        return np.asarray(spaces.flatten(leaf, value), dtype=np.float64).reshape(-1)
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        array = np.asarray(None)
    except Exception as error:  # a tensor with a gradient raises, and others may raise anything
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
