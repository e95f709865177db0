"""Numbers and truth values as users give them: Python's or NumPy's, taken over as Python's.

A truth value is no number here (`depth=True` is a slip, not 1), and NaN is none either.
"""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any, Final

import numpy as np

from serp.errors import SettingsError

FLOAT32_MAX: Final = float(np.finfo(np.float32).max)
"""The learner counts in float32: what is larger is infinite there."""


COUNTED: Final = 2**53
"""Most of what is counted: beyond it floats skip whole numbers."""
SIZE: Final = 10**9
"""Most of what memory is made for."""


def whole(value: Any, least: int, most: int | None = None) -> int | None:
    """Return a whole number from `least` to `most` as an int; None for anything else."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        return None
    number = int(value)
    return number if number >= least and (most is None or number <= most) else None


def real(value: Any, *, infinite: bool = False) -> float | None:
    """Return a number as a float, or as an int where it is one; None for anything else.

    Args:
        value: What may be a number.
        infinite: Whether the infinities count as numbers.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        return None
    try:
        number = int(value) if isinstance(value, Integral) else float(value)
        return number if math.isfinite(number) or (infinite and number == number) else None
    except OverflowError:  # a whole number beyond all floats
        return None


def truth(value: Any) -> bool | None:
    """Return a truth value as a bool; None for anything else."""
    return bool(value) if isinstance(value, bool | np.bool_) else None


def seed_of(value: Any) -> int:
    """Return a seed as an int.

    Raises:
        SettingsError: It is no whole number, or negative.
    """
    seed = whole(value, 0)
    if seed is None:
        raise SettingsError(f"the seed must be a whole number, 0 or more, not {value!r}")
    return seed
