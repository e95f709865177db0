"""The order of actions, used in all parts of planning and deciding.

An action that the file does not flag and whose risk is accepted comes first, then one that the file
does not flag, then one that it flags. Among equals the path with the least risk comes first, then
the one that is free of risk for longest, then the one with the largest value.

A risk that is accepted does not count: neither that of a step, nor what a path risks by chance
beyond the least (the slack of lexicographic value iteration: Wray, Zilberstein & Mouaddib, AAAI
2015). A path that is certain to do damage is never accepted. Where a graph shows the end of the
task, risks are those until then, see value_iteration.hpp.

Compiled code has the same in preference.hpp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.model.flags import APPLICABLE, RISKY, UNSAFE, risk_of

PathScore = tuple[int, float, int, float]
"""The score of a path: (-rank, -risk, steps, value); a better path has a larger one."""


def step_risk(flags: int, accepted: float) -> float:
    """Return the risk of one step, `serp.model.flags.risk_of`; 0 where it is accepted."""
    risk = risk_of(flags)
    return risk if risk > accepted else 0.0


def marked(flags: int, risk: float) -> int:
    """Return the flags of a step, with RISKY where its risk by `step_risk` is above 0."""
    return flags | RISKY if risk > 0.0 and not flags & UNSAFE else flags


def rank_of(flags: int) -> int:
    """Return 0 for a step whose risk is accepted, 1 where it is not, 2 where the file flags it."""
    if flags & UNSAFE:
        return 2
    return 1 if flags & RISKY else 0


def path_score(rank: int, risk: float, steps: int, value: float) -> PathScore:
    """Return the score of a path: `rank` is that of its first control period."""
    return -rank, -risk, steps, value


def free_of_risk(flags: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which steps are safe: applicable, not flagged by the file, of an accepted risk."""
    free: NDArray[np.bool_] = (flags & _JUDGED) == _FREE
    return free


_JUDGED, _FREE = np.array(APPLICABLE | UNSAFE | RISKY), np.array(APPLICABLE)
"""As arrays, because numbers are converted anew in every operation, which takes longer than it."""
