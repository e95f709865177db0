"""Restrict: the learner chooses among the actions of nearly optimal plans (DARLING)."""

from __future__ import annotations

import numpy as np

from serp.control.protocols import Mask, Proposer
from serp.control.strategies.strategy import Situation, Strategy
from serp.learning.dqn import Proposal
from serp.planning.action_map import ActionForecast


class Restrict(Strategy):
    """The learner acts, limited to actions whose best plan is nearly as good as the best plan.

    In DARLING (Leonetti, Iocchi and Stone 2016, Artificial Intelligence 241) the actions of plans
    whose cost is within a factor of the best one's are reasonable. The restriction applies to the
    choice, to exploration and to the value of the next state.
    """

    reads = ("guide.restrict_slack",)

    @property
    def choice(self) -> str:
        """In words: the learner's choice, with the restriction."""
        return "the learner's choice among the actions of good enough plans"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the learner's choice among reasonable actions, with exploration."""
        reasonable = self.allowed(situation.forecast, situation.admissible)
        return learner.propose(reasonable, among=reasonable)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the learner's choice among reasonable actions."""
        reasonable = self.allowed(situation.forecast, situation.admissible)
        return learner.propose_greedily(among=reasonable)

    def allowed(self, forecast: ActionForecast, admissible: Mask) -> Mask:
        """Return `[E]` the reasonable actions."""
        if not admissible.any():
            return admissible
        best = forecast.value[admissible].max()
        if not np.isfinite(best):  # the model knows none of them, or gives no finite value
            return admissible
        slack = self._settings.guide.restrict_slack
        reasonable: Mask = admissible & (forecast.value >= best - slack * abs(best))
        return reasonable
