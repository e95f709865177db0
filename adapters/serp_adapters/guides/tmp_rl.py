"""TMP-RL: the learner chooses among plans, and each is carried out before the next choice."""

from __future__ import annotations

import math

from serp.agent.protocols import Proposer
from serp.agent.strategy import Seed, Situation
from serp.learning.dqn import Proposal
from serp.settings import Settings
from serp_adapters.guides.darling import reasonable
from serp_adapters.guides.shared import Planned, best_among, explored_among


class TmpRl(Planned):
    """The learner chooses a plan, and the planner carries it out before the next choice (TMP-RL).

    Jiang, Yang, Zhang and Stone 2019, "Task-motion planning with reinforcement learning for
    adaptable mobile service robots", IROS, arXiv 1811.08955. There the learner (R-learning) has the
    values of actions by which a symbolic planner chooses its next plan. Here the planner gives the
    best plan from each action on; the learner's values choose among the good ones, by their first
    action, and the planner goes on from there for as many steps as it saw ahead, at most
    `planner.depth`. There is no planner of motions below the actions.
    """

    rho = math.nan  # whose turn it is depends on the plan that is carried out

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._left = [0] * settings.training.num_envs
        """Environment → steps until the learner chooses again."""

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the learner's choice among good plans"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the first action of the plan that the learner chooses, or None within a plan."""
        if self._left[self.env_index]:
            self._left[self.env_index] -= 1
            return None
        ahead = min(situation.forecast.depth, self._settings.planner.depth)
        self._left[self.env_index] = max(0, ahead - 1)
        return explored_among(reasonable(situation.forecast, situation.admissible), learner)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the first action of the plan with the largest value of the learner."""
        return best_among(reasonable(situation.forecast, situation.admissible), learner)

    def end_episode(self, return_: float, length: int) -> None:
        """Let the learner choose first in the next episode."""
        self._left[self.env_index] = 0
