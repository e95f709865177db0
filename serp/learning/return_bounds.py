"""Bounds on the discounted return, from the rewards observed so far.

A return is γ⁰c₀ + γ¹c₁ + … + γᵐt: m ≥ 0 rewards c ≤ c̄ of steps after which the episode goes on, and
the reward t ≤ t̄ of the step that terminates it. That is at most (1 − γᵐ) · c̄ / (1 − γ) + γᵐ · t̄, a
weighted mean of c̄ / (1 − γ) and t̄, so the largest return is the larger of the two, and likewise the
smallest. Separating both kinds of reward keeps the bounds tight: with 0 to 1 per step and −1 for a
fall, γ = 0.9, they are −1 and 10; the range of all rewards would give −10.

Only the *estimated* part of a TD target, the value of the next state, is clipped to these bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence


class ReturnBounds:
    """The smallest and the largest possible return, for a discount γ in [0, 1)."""

    def __init__(self, discount: float) -> None:
        self._horizon = 1.0 / (1.0 - discount)
        self._going_on = [math.inf, -math.inf]
        self._terminal = [math.inf, -math.inf]
        self._update()

    def observe(self, reward: float, terminated: bool) -> None:
        """Update the bounds with the reward of one step."""
        seen = self._terminal if terminated else self._going_on
        if seen[0] <= reward <= seen[1]:
            return
        seen[0] = min(seen[0], reward)
        seen[1] = max(seen[1], reward)
        self._update()

    def _update(self) -> None:
        lower = min(self._going_on[0] * self._horizon, self._terminal[0])
        upper = max(self._going_on[1] * self._horizon, self._terminal[1])
        nothing_known = lower > upper
        self.lower: float = -math.inf if nothing_known else lower
        self.upper: float = math.inf if nothing_known else upper

    def state(self) -> list[float]:
        """Return smallest and largest reward of going on, and of terminating; ±inf where unseen."""
        return [*self._going_on, *self._terminal]

    def load_state(self, state: Sequence[float]) -> None:
        """Continue from what `state` returned."""
        low, high, terminal_low, terminal_high = map(float, state)
        self._going_on = [low, high]
        self._terminal = [terminal_low, terminal_high]
        self._update()
