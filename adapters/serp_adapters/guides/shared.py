"""What several guides need: the planner's values without infinities, choices among actions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import best_of
from serp.agent.protocols import Mask, Proposer
from serp.agent.strategy import Strategy
from serp.learning.dqn import Proposal
from serp.tasks.action_map import ActionForecast


class Planned(Strategy):
    """A strategy that asks the planner in every state."""

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return True."""
        return True


def finite_values(forecast: ActionForecast) -> NDArray[np.float64]:
    """Return `[E]` what the best plan from each action on is worth.

    An action without a plan (it is not applicable, or the model does not know it) is worth as much
    as the worst plan; 0 if there is no plan.
    """
    values = forecast.value
    planned = np.isfinite(values)
    if planned.all():
        return values
    return np.where(planned, values, values[planned].min() if planned.any() else 0.0)


def best_among(allowed: Mask, learner: Proposer) -> Proposal:
    """Return the allowed action `[E]` with the largest value of the learner."""
    values = learner.values().mean(axis=0)
    return Proposal(best_of(np.where(allowed, values, -np.inf)), False)


def explored_among(allowed: Mask, learner: Proposer) -> Proposal:
    """Return the learner's proposal among allowed actions `[E]`, with its exploration."""
    proposal = learner.propose(allowed)
    if proposal.exploratory or allowed[proposal.action] or not allowed.any():
        return proposal
    return best_among(allowed, learner)
