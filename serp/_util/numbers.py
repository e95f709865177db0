"""Checks of numbers that users give, and the argmax of values that may be NaN.

Numbers of Python and NumPy become Python's. A truth value is not accepted as a number
(`depth=True` is a mistake, not 1), and neither is NaN.
"""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import SettingsError

FLOAT32_MAX: Final = float(np.finfo(np.float32).max)
"""The learner computes in float32, where larger numbers are infinite."""
COUNTED: Final = 2**53
"""Largest count: floats cannot represent every whole number beyond it."""
SIZE: Final = 10**9
"""Largest number of entries that memory is allocated for."""


def whole(value: Any, least: int, most: int | None = None) -> int | None:
    """Return a whole number from `least` to `most` as an int; None for anything else."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        return None
    number = int(value)
    return number if number >= least and (most is None or number <= most) else None


def real(value: Any) -> float | None:
    """Return a finite number as a float, or as an int if it is one; None for anything else."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return None
    try:
        number = int(value) if isinstance(value, Integral) else float(value)
        return number if math.isfinite(number) else None
    except OverflowError:  # a whole number beyond the largest float
        return None


def seed_of(value: Any) -> int:
    """Return a seed as an int; anything but a whole number from 0 on is a `SettingsError`."""
    seed = whole(value, 0)
    if seed is None:
        raise SettingsError(f"the seed must be a whole number, 0 or more, not {value!r}")
    return seed


def best_of(values: NDArray[np.floating[Any]]) -> int:
    """Return the first action with the largest of the values `[E]`; NaN is less than any number."""
    best = int(values.argmax())
    if values[best] == values[best]:
        return best
    known = np.flatnonzero(values == values)  # argmax takes the first NaN
    return int(known[values[known].argmax()]) if len(known) else best
