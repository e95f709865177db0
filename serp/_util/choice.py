"""The choice of the largest value among the actions that are allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
