"""Residual learning: Q is the planner's value plus what the network adds."""

from __future__ import annotations

import numpy as np

from serp._util.numbers import best_of
from serp.agent.decision import Decision
from serp.agent.protocols import Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, Situation
from serp.learning.dqn import Proposal
from serp_adapters.guides.shared import Planned, finite_values


class Residual(Planned):
    """The best action by the planner's value plus the learner's (residual learning).

    Johannink et al. 2019, "Residual reinforcement learning for robot control", ICRA, arXiv
    1812.03201, and Silver et al. 2018, "Residual policy learning", arXiv 1812.06298, add a learned
    control to that of a controller. Here values are added: Q(s, a) = Φ(s, a) + network(s, a), with
    Φ(s, a) the worth of the best plan from a on. The network then has to learn with the reward
    r + γ Φ(s', a') - Φ(s, a), where a' is the next action (look-ahead advice: Wiewiora, Cottrell
    and Elkan 2003, ICML), so that it is taught on-policy. A network that adds nothing leaves the
    planner's policy.
    """

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the best action by the planner's value plus the learner's"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the choice by the sum, or the learner's exploration."""
        proposal = learner.propose(situation.admissible)
        return proposal if proposal.exploratory else self.propose_greedily(situation, learner)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the choice by the sum."""
        sums = finite_values(situation.forecast) + learner.values().mean(axis=0)
        return Proposal(best_of(np.where(situation.admissible, sums, -np.inf)), False)

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Teach what the planner's values lack."""
        forecast, action = step.decision.forecast, step.decision.action
        base = float(finite_values(forecast)[action])
        if following is not None:
            after = float(finite_values(following.forecast)[following.action])
            only = np.arange(len(forecast.value)) == following.action
            reward = step.reward + self._settings.planner.discount * after - base
            return Lesson(reward, allowed=only)
        if step.terminated:
            return Lesson(step.reward - base)
        # Cut off. The plan expected `base` less the reward predicted for the step from the rest.
        return Lesson(step.reward - float(forecast.reward[action]))
