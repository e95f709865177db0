"""Advice: an action that something else than our own search proposes, checked by the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from serp.model.flags import APPLICABLE
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import Forecast, score_of
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings

Advise = Callable[[Mapping[str, float | bool]], Any]
"""Fluent → value, and returned: the name or position of a ground action, None for no advice."""
_MORE: Final = 1e-9
"""How much more than that of the best other action the value of advice is, at least."""


def advised(found: Forecast, action: int, worth: float = -np.inf) -> Forecast:
    """Return a forecast whose choice is the advised action, where nothing speaks against it.

    The value of advice is not known, and larger than that of any other action is what it claims.
    So the action is chosen if it is the best one with that value: advice never prevails over risk.

    Args:
        found: The planner's own forecast, which knows the risks.
        action: Position of the advised ground action; -1: none.
        worth: Discounted sum of rewards that it leads to, if that is known.
    """
    if action < 0 or not found.flags[action] & APPLICABLE:
        return found
    others = np.delete(found.value, action)
    best = others[np.isfinite(others)].max(initial=-np.inf)
    value = found.value.copy()
    value[action] = max(value[action], worth)
    if np.isfinite(best):
        value[action] = max(value[action], best + _MORE * max(1.0, abs(best)))
    claimed = found._replace(value=value)
    if score_of(claimed, action) < score_of(claimed, found.choice):
        return found
    return claimed._replace(choice=action)


class AdvisedPlanner:
    """Follows advice where the lookahead predicts no more risk of it than of other actions.

    Args:
        model: The transition model.
        settings: The settings of the lookahead.
        advise: State `[F]` → position of a ground action; -1 where there is no advice.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, advise: Callable[[Vector], int]
    ) -> None:
        self.model = model
        self._near = Lookahead(model, settings)
        self._advise = advise

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        return advised(self._near.forecast(state), self._advise(state))
