"""Saved arrays of a whole and its parts: `learner.replay.rewards` is one of the part `learner`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


def nested(part: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """Return the arrays of a part by the names that they have in the whole."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def part_of(arrays: Mapping[str, NDArray[Any]], part: str) -> Arrays:
    """Return the arrays of one part of a whole, by the names that they have in the part."""
    prefix = f"{part}."
    return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}
