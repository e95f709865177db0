"""The three periods of the simulation: physics step, control tick, decision."""

from __future__ import annotations

from typing import Final

PHYSICS_STEP: Final = 0.02
"""Seconds of one physics step, always the same: contacts persist from step to step."""
STEPS_PER_TICK: Final = 5
"""Physics steps in one tick of the controllers."""
TICK: Final = 0.1
"""Seconds of one tick of the controllers and the referee."""
TICKS_PER_DECISION: Final = 4
"""Ticks for which one choice of the defender holds."""
DECISION: Final = 0.4
"""Seconds between two decisions of the defender."""


def ticks(seconds: float) -> int:
    """Return the whole number of ticks nearest to a duration.

    Times are counted in ticks, as integers, so that 0.6 s are never 5 or 7 ticks for rounding.
    """
    return round(seconds / TICK)
