"""Argmax over both proposals: the one with the larger Q (IBRL, Hu et al. 2024)."""

from __future__ import annotations

from serp.control.protocols import Proposer
from serp.control.strategies.advice import advice
from serp.control.strategies.strategy import Situation, Strategy
from serp.learning.dqn import Proposal
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast


class ArgmaxQ(Strategy):
    """Executes the better of the planner's and the learner's proposal, and bootstraps from it.

    Imitation Bootstrapped Reinforcement Learning (Hu et al. 2024, arXiv 2311.02198), with the
    planner in place of the imitation policy: the proposal with the larger value in the target
    network is executed, and the value of a next state is that of the better proposal there. If both
    have the same value, the planner acts.
    """

    guided = GuidedLearning(bootstrap_guide=True)

    @property
    def choice(self) -> str:
        """In words: the better proposal."""
        return "the planner's or the learner's choice, whichever the learner values more"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the better proposal; exploration is the learner's."""
        return _better(situation, learner, learner.propose(situation.admissible))

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the better proposal."""
        return _better(situation, learner, learner.propose_greedily())

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's choice in the next state."""
        scale = self._settings.learner.reward_scale
        return advice(forecast, action, following, scale=scale, imitate=False)


def _better(situation: Situation, learner: Proposer, proposal: Proposal) -> Proposal | None:
    planned = situation.forecast.choice
    if planned < 0 or not situation.admissible[planned]:
        return proposal
    q = learner.target_q()
    return None if q[planned] >= q[proposal.action] else proposal
