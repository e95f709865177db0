"""What a predicted step is like, as bits, and the risk that a learned model sees in it.

The flags of a step are a whole number of 64 bits. Its lower eight are the bits below; the others
hold the risk in fixed point, in units of 2⁻²⁴. The first three functions run in CPython and are
compiled by numba, so that none of them calls another.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

APPLICABLE = 1
"""The precondition holds, and there is a next state."""
UNSAFE = 2
"""By the file as written, `(unsafe)` becomes true. Nothing learned sets or clears it."""
TERMINAL = 4
"""`(terminal)` has become true, or the goal is reached."""
UNDEFINED = 8
"""The precondition does not fail, but the step has no result: something divides by zero, is no
finite number, or contradicts something else. UNSAFE beside it is certain all the same."""
RISKY = 16
"""The risk of a step that is not UNSAFE is larger than what is accepted; planners set it."""

RISK_SHIFT: Final = 8
RISK_UNIT: Final = 2.0**-24
"""Where the risk begins, and what its last bit stands for."""


def risk_of(flags: int) -> float:
    """Return the predicted probability, in [0, 1], that a step is unsafe; 1 where it is UNSAFE."""
    return 1.0 if flags & UNSAFE else (flags >> RISK_SHIFT) * RISK_UNIT


def with_risk(flags: int, risk: float) -> int:
    """Return flags that have no risk yet with one in [0, 1], rounded to a multiple of 2⁻²⁴."""
    return flags | (int(risk / RISK_UNIT + 0.5) << RISK_SHIFT)


def joined(flags: int, further: int) -> int:
    """Return the flags of two steps taken one after the other: all bits, and the risk of both."""
    bits = (flags | further) & 0xFF
    first, second = flags >> RISK_SHIFT, further >> RISK_SHIFT
    if first | second:
        safe = (1.0 - first * RISK_UNIT) * (1.0 - second * RISK_UNIT)
        bits |= int((1.0 - safe) / RISK_UNIT + 0.5) << RISK_SHIFT
    return bits


def risks_of(flags: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return `risk_of` each of some flags."""
    return np.where(flags & UNSAFE, 1.0, (flags >> RISK_SHIFT) * RISK_UNIT)
