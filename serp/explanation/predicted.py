"""What an account of a decision asks of a planner's prediction."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from serp.planning.limits import Bound


class Predicted(Protocol):
    """What a planner predicts for each of some actions, `[A]` or `[E]`; see `Forecast`."""

    @property
    def value(self) -> NDArray[np.float64]:
        """Discounted sum of rewards of the best path."""

    @property
    def path_risk(self) -> NDArray[np.float64]:
        """Probability of an unsafe step on that path."""

    @property
    def safe_steps(self) -> NDArray[np.int64]:
        """Control periods on that path before the first risk."""

    @property
    def reward(self) -> NDArray[np.float64]:
        """Reward of one control period."""

    @property
    def flags(self) -> NDArray[np.int64]:
        """Flags of one control period."""

    @property
    def bound(self) -> Bound:
        """What ended the planner's sight."""
