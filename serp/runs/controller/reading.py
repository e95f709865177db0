"""Values of `policy.json` and arrays of `arrays.npz`, checked where they are taken.

Positions are checked against what they are positions in, so that a damaged folder, or one put
together from two, is refused at loading, by the name of the file and of the entry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .folder import ARRAYS, POLICY, ControllerError

Array = NDArray[Any]
_Kind = TypeVar("_Kind", list[Any], dict[str, Any], str, bool)

_AGAIN = "export the run again"
_NAMES = {list: "a list", dict: "an object", str: "a text", bool: "true or false"}


class Entry:
    """A value of `policy.json`.

    Args:
        value: The value.
        place: Where it is, such as `planner.depth`; empty for the whole file.
    """

    def __init__(self, value: object, place: str = "") -> None:
        self._value, self._place = value, place

    def __getitem__(self, name: str) -> Entry:
        values, place = self._of(dict), f"{self._place}.{name}".lstrip(".")
        if name not in values:
            raise ControllerError(f"{POLICY}: {place} is missing; {_AGAIN}")
        return Entry(values[name], place)

    def _of(self, kind: type[_Kind]) -> _Kind:
        if not isinstance(self._value, kind):
            raise self.wrong(f"it must be {_NAMES[kind]}")
        return self._value

    def wrong(self, why: str) -> ControllerError:
        """Return an error that names the entry."""
        shown = repr(self._value)
        shown = shown if len(shown) <= 60 else shown[:57] + "..."
        return ControllerError(f"{POLICY}: {self._place} is {shown}: {why}; {_AGAIN}")

    @property
    def value(self) -> Any:
        """The value as it is."""
        return self._value

    @property
    def none(self) -> bool:
        """Whether it is null."""
        return self._value is None

    def text(self) -> str:
        """Return a text."""
        return self._of(str)

    def truth(self) -> bool:
        """Return a truth value."""
        return self._of(bool)

    def items(self, length: int | None = None) -> list[Entry]:
        """Return the entries of a list, of any length or of this one."""
        values = self._of(list)
        if length is not None and len(values) != length:
            raise self.wrong(f"it must have {length} entries")
        return [Entry(value, f"{self._place}[{k}]") for k, value in enumerate(values)]

    def whole(self, low: int, high: int | None = None) -> int:
        """Return a whole number from `low` to `high`."""
        value = self._value
        if type(value) is not int or value < low or (high is not None and value > high):
            limits = f"of at least {low}" if high is None else f"from {low} to {high}"
            raise self.wrong(f"it must be a whole number {limits}")
        return value

    def positions(self, size: int, length: int | None = None) -> list[int]:
        """Return different positions in something of a size."""
        found = [item.whole(0, size - 1) for item in self.items(length)]
        if len(set(found)) < len(found):
            raise self.wrong("each may occur once")
        return found

    def number(self) -> float:
        """Return a finite number."""
        value = self._value
        try:
            found = float(value) if type(value) in (int, float) else math.nan  # type: ignore[arg-type]
        except OverflowError:
            found = math.inf
        if not math.isfinite(found):
            raise self.wrong("it must be a finite number")
        return found


class Arrays:
    """Arrays of `arrays.npz`.

    Args:
        arrays: Name → array.
        prefix: With which the names begin that are asked for.
    """

    def __init__(self, arrays: Mapping[str, Array], prefix: str = "") -> None:
        self._arrays, self._prefix = arrays, prefix

    def under(self, prefix: str) -> Arrays:
        """Return those whose names begin with a prefix."""
        return Arrays(self._arrays, self._prefix + prefix)

    def wrong(self, name: str, why: str) -> ControllerError:
        """Return an error that names an array."""
        return ControllerError(f"{ARRAYS}: {self._prefix}{name} {why}; {_AGAIN}")

    def numbers(self, name: str, *shape: int | None, finite: bool = True) -> Array:
        """Return an array of numbers of a shape; None stands for any length."""
        found = self._arrays.get(self._prefix + name)
        if found is None:
            raise self.wrong(name, "is missing")
        if len(found.shape) != len(shape) or any(
            wanted not in (None, size) for wanted, size in zip(shape, found.shape, strict=True)
        ):
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise self.wrong(name, f"has shape {list(found.shape)}, not [{wanted}]")
        if found.dtype not in (np.float64, np.int64):
            raise self.wrong(name, f"holds {found.dtype}, not numbers of 64 bits")
        if finite and not np.isfinite(found).all():
            raise self.wrong(name, "holds a number that is not finite")
        return found

    def whole(self, name: str, low: int, high: int | None, *shape: int | None) -> Array:
        """Return an array of whole numbers from `low` to `high`, as int64."""
        found = self.numbers(name, *shape)
        wrong = (found != np.floor(found)) | (found < low)
        if high is not None:
            wrong |= found > high
        if wrong.any():
            place = [int(k) for k in np.argwhere(wrong)[0]]
            limits = f"of at least {low}" if high is None else f"from {low} to {high}"
            raise self.wrong(
                f"{name}{place}",
                f"is {found[tuple(place)]:g}: it must be a whole number {limits}",
            )
        whole: Array = found.astype(np.int64)
        return whole
