"""What the planner knows of every action in one state, whichever form computed it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.domain.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.planning.settings import Bound

SAFE = 1 << 30
"""Safe control periods of a path on which nothing is predicted unsafe."""


class Forecast(NamedTuple):
    """The planner's view of one state.

    Attributes:
        choice: The first action of the best path; -1 where no action is applicable. Best means:
            safe for the longest time, then the largest discounted sum of rewards, then first in
            the file. Both hold at every node, so that what follows an unsafe edge is again the
            best that is left.
        value: `[A]` discounted sum of rewards of the best path that begins with each action, and
            of what its end is worth where that is known (`Lookahead.leaves`); -inf where not
            applicable.
        safe_steps: `[A]` control periods before the first unsafe one on that path (an edge of the
            planner's setting `repeat` has several), or before it reaches a state where every
            action that might be applicable has an undefined result; SAFE where there is none,
            -1 where not applicable.
        reward: `[A]` predicted reward of one control period.
        flags: `[A]` predicted for one control period; see `serp.domain.flags`.
        depth: Layers that were expanded.
        bound: What ended the expansion.
    """

    choice: int
    value: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]
    depth: int
    bound: Bound

    @property
    def applicable(self) -> NDArray[np.bool_]:
        """`[A]` whether the precondition holds."""
        return (self.flags & APPLICABLE).astype(np.bool_)

    @property
    def unsafe(self) -> NDArray[np.bool_]:
        """`[A]` whether the action is predicted unsafe."""
        return (self.flags & UNSAFE).astype(np.bool_)

    @property
    def terminal(self) -> NDArray[np.bool_]:
        """`[A]` whether the action is predicted to end the task."""
        return (self.flags & TERMINAL).astype(np.bool_)

    @property
    def safe(self) -> bool:
        """Whether nothing on the chosen path is predicted unsafe."""
        return self.choice >= 0 and int(self.safe_steps[self.choice]) == SAFE

    @property
    def indifferent(self) -> bool:
        """Whether the planner has no reason to prefer one action; see `all_alike`."""
        return all_alike(self.value, self.safe_steps, self.flags)


def all_alike(
    value: NDArray[np.float64], safe_steps: NDArray[np.int64], flags: NDArray[np.int64]
) -> bool:
    """Return whether there are two or more actions to choose from and all promise the same.

    Actions that are predicted unsafe are no choice while there is another.
    """
    safe = (flags & (APPLICABLE | UNSAFE)) == APPLICABLE
    chosen = np.flatnonzero(safe if safe.any() else flags & APPLICABLE)
    if len(chosen) < 2:
        return False
    first = chosen[0]
    return bool(
        (value[chosen] == value[first]).all() and (safe_steps[chosen] == safe_steps[first]).all()
    )
