"""Acting under ignorance: the planner tries what it has hardly seen, where that is safe.

In the spirit of R-Max (Brafman & Tennenholtz, 2002): what was tried too seldom to be known is
preferred, here only where the model predicts that it stays safe for the whole lookahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.planning.forecast import SAFE, Forecast
from serp.planning.preference import free_of_risk


class ExplorationBonus:
    """Makes a planner prefer actions that it knows little of.

    Args:
        tried: `[A]` how often each ground action was observed; kept up to date by its owner.
        tries: So often an action is tried before it counts as known; 0: nothing is preferred.
    """

    def __init__(self, tried: NDArray[np.int64], tries: int) -> None:
        self._tried = tried
        self._tries = tries

    def __call__(self, forecast: Forecast) -> Forecast:
        """Return a forecast with the choice of the least known action that is safe."""
        if self._tried.min(initial=self._tries) >= self._tries:
            return forecast
        candidates = free_of_risk(forecast.flags)
        lasting = candidates & (forecast.safe_steps == SAFE)
        if lasting.any():
            candidates = lasting
        # Where all that is known leads to harm, what is not known is the better choice.
        candidates &= self._tried < self._tries
        if not candidates.any():
            return forecast
        least = np.where(candidates, self._tried, np.iinfo(np.int64).max)
        return forecast._replace(choice=int(least.argmin()))
