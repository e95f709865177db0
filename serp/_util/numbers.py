"""Numbers as users give them, and the largest of several.

Python's and NumPy's numbers are taken over as Python's. A truth value is not a number
here (`depth=True` is a mistake, not 1), and neither is NaN.
"""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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


def seed_of(value: Any) -> int:
    """Return a seed as an int.

    Raises:
        SettingsError: It is not a whole number, or negative.
    """
    seed = whole(value, 0)
    if seed is None:
        raise SettingsError(f"the seed must be a whole number, 0 or more, not {value!r}")
    return seed


def best_of(values: NDArray[np.floating[Any]], among: NDArray[np.bool_] | None = None) -> int:
    """Return the allowed action of the largest value, whatever the values are.

    Args:
        values: `[E]`; infinities are compared as such, and NaN comes after everything.
        among: `[E]` the actions that are allowed; None for all.

    Returns:
        An action that is allowed, the first among equals; -1 where none is.
    """
    allowed = np.arange(len(values)) if among is None else np.flatnonzero(among)
    if not len(allowed):
        return -1
    chosen = values[allowed]
    best = int(chosen.argmax())
    if chosen[best] != chosen[best]:  # argmax takes the first NaN
        numbers = ~np.isnan(chosen)
        if numbers.any():
            return int(allowed[numbers][chosen[numbers].argmax()])
    return int(allowed[best])
