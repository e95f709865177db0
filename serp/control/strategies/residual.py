"""Residual learning: Q is the planner's value plus the network's output."""

from __future__ import annotations

from serp.control.protocols import Proposer, Values
from serp.control.strategies.advice import advice, values_of
from serp.control.strategies.strategy import Situation, Strategy
from serp.learning.dqn import Proposal
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast


class Residual(Strategy):
    """The learner acts on Q(s, a) = planner's value of a + network(s, a).

    Residual learning (Johannink et al. 2019, arXiv 1812.03201; Silver et al. 2018, arXiv
    1812.06298), applied to values instead of controls: the network learns the error of the
    planner's value. If its output is 0, the policy is the planner's.
    """

    guided = GuidedLearning(residual=True)

    @property
    def choice(self) -> str:
        """In words: the learner's choice, which uses the planner's values."""
        return "the learner's choice, the planner's values a part of its own"

    baseline = choice

    def propose(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the action with the largest sum, with exploration."""
        return learner.propose(situation.admissible, base=self.base(situation.forecast))

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the action with the largest sum."""
        return learner.propose_greedily(base=self.base(situation.forecast))

    def base(self, forecast: ActionForecast) -> Values:
        """Return `[E]` the planner's values."""
        return values_of(forecast, self._settings.learner.reward_scale)

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's values."""
        scale = self._settings.learner.reward_scale
        return advice(forecast, action, following, scale=scale, imitate=False)
