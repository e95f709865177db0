"""Checked access to the arrays and values of a checkpoint.

A checkpoint may come from an untrusted source, or be damaged in a way that its digest does not
show. Compiled code does not check bounds: an index beyond an array reads or writes foreign memory.
Everything that is restored is therefore checked here, once, by type, shape and range.
"""

from __future__ import annotations

import copy
import reprlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from serp.errors import RunError

LARGEST: Final = float(np.finfo(np.float64).max)
MOST: Final = 2**53
"""Largest count: whole numbers up to it are exact as floats, too."""

_MOST_OF_GENERATORS: Final = {
    "has_uint32": 1, "uinteger": 2**32 - 1, "pos": 624, "buffer_pos": 4,
}  # fmt: skip
"""Largest values of entries in the states of NumPy's generators, which NumPy does not check."""

Arrays = dict[str, npt.NDArray[Any]]


_Check = tuple[Callable[[Any], bool], str]
"""A check of a JSON value, and what passes it, for messages."""
_TRUTH: Final[_Check] = (lambda value: isinstance(value, bool), "true or false")


def nested(part: str, arrays: Mapping[str, npt.NDArray[Any]]) -> Arrays:
    """Return the arrays of a part with its name as prefix, such as `learner.replay.rewards`."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def part_of(arrays: Mapping[str, npt.NDArray[Any]], part: str) -> Arrays:
    """Return the arrays of one part, without its prefix."""
    prefix = f"{part}."
    return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}


class Saved:
    """The arrays and JSON values of one part of a checkpoint, the state of `what`.

    Every method raises `RunError` if the value is missing or does not pass the check.
    """

    def __init__(self, what: str, arrays: Mapping[str, npt.NDArray[Any]], meta: Any) -> None:
        self._what = what
        self._arrays = arrays
        self._meta: Mapping[str, Any] = meta if isinstance(meta, Mapping) else {}

    def part(self, name: str) -> tuple[dict[str, npt.NDArray[Any]], Any]:
        """Return the arrays and JSON values of a part, for its `load_state_dict`."""
        return part_of(self._arrays, name), self._value(name)

    def has(self, name: str) -> bool:
        """Return whether an array or JSON value of that name exists."""
        return name in self._arrays or name in self._meta

    def array(
        self,
        name: str,
        dtype: npt.DTypeLike,
        shape: tuple[int, ...],
        low: float | None = -LARGEST,
        high: float = LARGEST,
    ) -> npt.NDArray[Any]:
        """Return an array of a dtype and a shape, in which -1 is any length.

        Its values are from `low` to `high`, by default finite. None: no check, NaN is allowed.
        """
        if name not in self._arrays:
            raise self.wrong(f"{name} is missing")
        array = self._arrays[name]
        if array.dtype != np.dtype(dtype):
            raise self.wrong(f"{name} has type {array.dtype}, not {np.dtype(dtype)}")
        if array.ndim != len(shape) or any(
            wanted not in (-1, size) for size, wanted in zip(array.shape, shape, strict=True)
        ):
            expected = str(shape).replace("-1", "any")
            raise self.wrong(f"{name} has shape {array.shape}, not {expected}")
        # Compare in float64, whatever the dtype.
        if low is not None and not ((array >= np.float64(low)) & (array <= np.float64(high))).all():
            raise self.wrong(f"{name} has values outside the range {low:g} to {high:g}")
        return array

    def whole(self, name: str, low: int = 0, high: int = MOST) -> int:
        """Return a whole number from `low` to `high`."""
        return int(self._checked(name, self._value(name), _whole(low, high)))

    def wholes(self, name: str, length: int, low: int = 0, high: int = MOST) -> list[int]:
        """Return a list of `length` whole numbers."""
        return self._list(name, length, _whole(low, high))

    def real(self, name: str, low: float = -LARGEST, high: float = LARGEST) -> float:
        """Return a number from `low` to `high`, never NaN."""
        return float(self._checked(name, self._value(name), _real(low, high)))

    def reals(self, name: str, length: int) -> list[float]:
        """Return a list of `length` finite numbers."""
        return [float(value) for value in self._list(name, length, _real(-LARGEST, LARGEST))]

    def truth(self, name: str) -> bool:
        """Return a truth value."""
        return bool(self._checked(name, self._value(name), _TRUTH))

    def truths(self, name: str, length: int) -> list[bool]:
        """Return a list of `length` truth values."""
        return self._list(name, length, _TRUTH)

    def generator_state(self, name: str, generator: np.random.Generator) -> Mapping[str, Any]:
        """Return the state of a random generator of the same kind."""
        value = self._value(name)
        try:
            return state_for(generator, value)
        except ValueError as error:
            raise self.wrong(f"{name} is {reprlib.repr(value)}, not {error}") from None

    def equal(self, name: str, here: Any, advice: str) -> None:
        """Check that a JSON value equals the one of this run; `advice` is what to do if not."""
        saved = self._value(name)
        if saved != here or isinstance(saved, bool) != isinstance(here, bool):
            raise RunError(
                f"the saved {self._what} has {name} {reprlib.repr(saved)}, but this run "
                f"has {reprlib.repr(here)}; {advice}"
            )

    def wrong(self, why: str) -> RunError:
        """Return the error for a saved state that cannot be used."""
        return RunError(
            f"the saved {self._what} cannot be restored: {why}. If the domain, task or "
            "settings have changed, continue with the original ones. If not, the checkpoint "
            "is damaged: restore it from a copy"
        )

    def _value(self, name: str) -> Any:
        if name not in self._meta:
            raise self.wrong(f"{name} is missing")
        return self._meta[name]

    def _list(self, name: str, length: int, check: _Check) -> list[Any]:
        values = self._value(name)
        if not isinstance(values, list) or len(values) != length:
            raise self.wrong(f"{name} is {reprlib.repr(values)}, not a list of {length}")
        return [self._checked(name, value, check) for value in values]

    def _checked(self, name: str, value: Any, check: _Check) -> Any:
        fits, expected = check
        if not fits(value):
            raise self.wrong(f"{name} is {reprlib.repr(value)}, not {expected}")
        return value


Reader = Callable[[Saved, str, Any], Any]
"""(saved state, name, value of today) → checked value of an attribute."""


class Declared:
    """A class whose state in a checkpoint is declared once, as attribute → `Reader`.

    Its name in the checkpoint has no underscore. Nothing changes unless all can be read.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {}

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {name.lstrip("_"): _json_of(getattr(self, name)) for name in self.STATE}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        saved = Saved(type(self).__name__, {}, meta)
        values = {
            name: read(saved, name.lstrip("_"), getattr(self, name))
            for name, read in self.STATE.items()
        }
        for name, value in values.items():
            setattr(self, name, value)


def _json_of(value: Any) -> Any:
    if isinstance(value, np.random.Generator):
        return value.bit_generator.state
    return value.state_dict() if hasattr(value, "state_dict") else value


def count(saved: Saved, name: str, own: Any) -> int:
    """Read a whole number from 0 on."""
    return saved.whole(name)


def truths(saved: Saved, name: str, own: list[bool]) -> list[bool]:
    """Read as many truth values as there are."""
    return saved.truths(name, len(own))


def within(low: float, high: float = LARGEST) -> Reader:
    """Return the reader of a number from `low` to `high`."""
    return lambda saved, name, own: saved.real(name, low, high)


probability: Final = within(0.0, 1.0)


def counts_of(names: Iterable[str]) -> Reader:
    """Return the reader of a `Counter` with some of the names."""
    known = {str(name): name for name in names}

    def read(saved: Saved, name: str, own: Any) -> Counter[str]:
        counts = saved.part(name)[1]
        if not isinstance(counts, dict) or not counts.keys() <= known.keys():
            raise saved.wrong(
                f"{name} is {reprlib.repr(counts)}, not a mapping from names to counts"
            )
        entry = Saved(name, {}, counts)
        return Counter({known[key]: entry.whole(key) for key in counts})

    return read


def random(saved: Saved, name: str, own: np.random.Generator) -> np.random.Generator:
    """Read the state of a random generator of the same kind."""
    read = copy.deepcopy(own)
    read.bit_generator.state = saved.generator_state(name, own)
    return read


def part(saved: Saved, name: str, own: Any) -> Any:
    """Restore an object with a state of its own."""
    own.load_state_dict(saved.part(name)[1])
    return own


def whole_within(value: Any, low: int, high: int) -> bool:
    """Return whether a JSON value is a whole number from `low` to `high`."""
    return type(value) is int and low <= value <= high


def _whole(low: int, high: int) -> _Check:
    return lambda value: whole_within(value, low, high), f"a whole number from {low} to {high}"


def _real(low: float, high: float) -> _Check:
    def fits(value: Any) -> bool:
        return type(value) in (int, float) and low <= value <= high  # exact for large whole ones

    return fits, f"a number from {low:g} to {high:g}"


def state_for(generator: np.random.Generator, saved: Any) -> Mapping[str, Any]:
    """Return the saved state of a generator in the form that its setter takes, or a ValueError."""
    state: Mapping[str, Any] = _like(saved, generator.bit_generator.state, "")
    return state


def _like(saved: Any, own: Any, name: str) -> Any:
    if isinstance(own, Mapping) and isinstance(saved, Mapping) and saved.keys() == own.keys():
        return {key: _like(saved[key], value, key) for key, value in own.items()}
    if isinstance(own, np.ndarray) and isinstance(saved, list) and len(saved) == own.size:
        most = int(np.iinfo(own.dtype).max)
        if all(whole_within(value, 0, most) for value in saved):
            return np.array(saved, own.dtype).reshape(own.shape)
    most = _MOST_OF_GENERATORS.get(name, 2**128 - 1)
    odd = name == "inc"  # PCG needs an odd increment
    if isinstance(own, int) and whole_within(saved, 0, most) and (saved % 2 or not odd):
        return saved
    if isinstance(own, str) and isinstance(saved, str) and saved == own:
        return saved
    raise ValueError("the state of a random generator of this kind")
