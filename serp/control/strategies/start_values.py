"""The luck of an episode's first state, taken out of its return."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from serp._util.saved_state import Saved

_RATE: Final = 0.1
"""Least weight of a new value in the mean value, which drifts as the learner learns."""
_CAUTION: Final = 2.0
"""Episodes by which the slope is shrunk towards 0."""


class StartValues:
    """The learner's value of the first state as a control variate of the return.

    Where episodes begin in different states, much of what their returns differ by is due to that.
    The first state does not depend on who leads, so a multiple of its value's deviation from the
    mean can be subtracted without bias; the slope of a regression leaves the least variance
    (Lavenberg & Welch 1981; CUPED: Deng et al. 2013).

    Attributes:
        level: Mean value of recent first states.
        cross, square: Weighted sums of deviation of value × deviation of return, and of deviation
            of value squared.
        count: Sum of the weights.
        episodes: Number of episodes.
    """

    def __init__(self) -> None:
        self.level = self.cross = self.square = self.count = 0.0
        self.episodes = 0

    @property
    def slope(self) -> float:
        """What a return is higher by, per unit of the first state's value; at least 0."""
        if not (self.square > 0.0 and self.cross > 0.0):
            return 0.0
        return self.cross / self.square * (self.count / (self.count + _CAUTION))

    def luck(self, value: float) -> float:
        """Return what an episode is expected to be better than others for its first state."""
        return self.slope * (value - self.level) if self.episodes else 0.0

    def fade(self, by: float) -> None:
        """Reduce the weight of everything so far."""
        self.cross *= by
        self.square *= by
        self.count *= by

    def add(self, value: float, surprise: float | None) -> None:
        """Add the value of a first state.

        Args:
            value: The value.
            surprise: What the return was above the mean of those of the same lead; None if there
                was none.
        """
        off = value - self.level
        if self.episodes and surprise is not None:
            self.cross += off * surprise
            self.square += off * off
            self.count += 1.0
        self.episodes += 1
        self.level += off * max(_RATE, 1.0 / self.episodes)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return vars(self).copy()

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("first states", {}, meta)
        self.episodes = saved.whole("episodes")
        self.count = saved.real("count", 0.0, self.episodes)
        self.level, self.cross = saved.real("level"), saved.real("cross")
        self.square = saved.real("square", 0.0)
