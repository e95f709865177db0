"""The flags of a predicted step, and the risk that a learned model adds to them.

Flags are a 64-bit integer. Its lower eight bits are those below. From bit 8 on it holds the risk,
in units of 2⁻²⁴, and from bit 34 on the learned chance that the task ends, in units of 1/65535.
`flags.hpp` is the same for compiled code.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

APPLICABLE = 1
"""The precondition holds, and there is a next state."""
UNSAFE = 2
"""The file as written makes `(unsafe)` true. Nothing learned sets or clears this flag."""
TERMINAL = 4
"""`(terminal)` has become true, or the goal is reached. Nothing learned sets this flag; where an
end has proved doubtful it is cleared, and there is a chance of it instead."""
UNDEFINED = 8
"""The precondition does not fail, but the step has no result: a division by zero, a number that is
not finite, or contradicting effects. UNSAFE is valid where it is set as well."""
RISKY = 16
"""The risk of a step that is not UNSAFE exceeds the accepted risk; planners set it."""

RISK_SHIFT: Final = 8
RISK_UNIT: Final = 2.0**-24
"""The position of the lowest bit of the risk, and its value."""
_RISK_MASK: Final = (1 << 25) - 1
END_SHIFT: Final = 34
END_MASK: Final = (1 << 16) - 1
"""The position of the lowest bit of the chance of an end, and the largest chance."""


def risk_units(flags: int) -> int:
    """Return the risk in flags, in units of `RISK_UNIT`."""
    return (flags >> RISK_SHIFT) & _RISK_MASK


def risk_of(flags: int) -> float:
    """Return the predicted probability, in [0, 1], that a step is unsafe; 1 where it is UNSAFE."""
    return 1.0 if flags & UNSAFE else risk_units(flags) * RISK_UNIT


def going_on(flags: int) -> float:
    """Return the probability that the task goes on after a step that is not TERMINAL."""
    return 1.0 - (flags >> END_SHIFT & END_MASK) / END_MASK


def joined(flags: int, further: int) -> int:
    """Return the flags of two consecutive steps, without chances of ends: bits and joint risk."""
    bits = (flags | further) & 0xFF
    first, second = risk_units(flags), risk_units(further)
    if first | second:
        safe = (1.0 - first * RISK_UNIT) * (1.0 - second * RISK_UNIT)
        bits |= int((1.0 - safe) / RISK_UNIT + 0.5) << RISK_SHIFT
    return bits


def risks_of(flags: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return `risk_of` for each entry of an array of flags."""
    return np.where(flags & UNSAFE, 1.0, (flags >> RISK_SHIFT & _RISK_MASK) * RISK_UNIT)
