"""The colours that stand for who acted, the same in curves and on films.

Okabe and Ito's palette, told apart by colour-blind readers too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

PLANNER: Final = "#0072B2"
LEARNER: Final = "#E69F00"
EXPLORATION: Final = "#009E73"
FALLBACK: Final = "#8A8F98"
ACTORS: Final[Mapping[str, str]] = {
    "planner": PLANNER,
    "learner": LEARNER,
    "exploration": EXPLORATION,
    "fallback": FALLBACK,
}
"""Values of `serp.control.arbiter.Actor` → colour."""
REFUSED: Final = "#B5271B"
"""What was refused, and what is unsafe: red as in a planning graph."""
