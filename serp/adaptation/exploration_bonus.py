"""Exploration by the planner: a preference for actions with few visits that are safe.

In the spirit of R-Max (Brafman & Tennenholtz, Journal of Machine Learning Research 3, 2002), but
only among actions that the model predicts to stay safe for the whole lookahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.planning.forecast import SAFE, Forecast
from serp.planning.preference import free_of_risk


class ExplorationBonus:
    """Makes a planner prefer actions with fewer visits than `min_visits`; 0: no preference.

    `visits` `[A]` counts how often each ground action was observed; its owner updates it.
    """

    def __init__(self, visits: NDArray[np.int64], min_visits: int) -> None:
        self._visits = visits
        self._min_visits = min_visits

    def __call__(self, forecast: Forecast) -> Forecast:
        """Return a forecast whose choice is the least visited action that is safe."""
        if self._visits.min(initial=self._min_visits) >= self._min_visits:
            return forecast
        candidates = free_of_risk(forecast.flags)
        lasting = candidates & (forecast.safe_steps == SAFE)
        if lasting.any():
            candidates = lasting
        # If all known actions become unsafe, an unknown one is the better choice.
        candidates &= self._visits < self._min_visits
        if not candidates.any():
            return forecast
        least = np.where(candidates, self._visits, np.iinfo(np.int64).max)
        return forecast._replace(choice=int(least.argmin()))
