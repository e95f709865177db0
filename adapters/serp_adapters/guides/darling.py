"""DARLING: plans decide which actions are reasonable, the learner chooses among them."""

from __future__ import annotations

from typing import Final

import numpy as np

from serp.agent.decision import Decision
from serp.agent.protocols import Mask, Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, Situation
from serp.learning.dqn import Proposal
from serp.tasks.action_map import ActionForecast
from serp_adapters.guides.shared import Planned, best_among, explored_among

_SLACK: Final = 0.5
"""A reasonable plan costs at most 1.5 times as much as the best one."""


def reasonable(forecast: ActionForecast, admissible: Mask) -> Mask:
    """Return `[E]` the admissible actions whose best plan is nearly as good as the best of all."""
    if not admissible.any():
        return admissible
    best = float(forecast.value[admissible].max())
    if best == -np.inf:  # the model knows none of them
        return admissible
    within: Mask = admissible & (forecast.value >= best - _SLACK * abs(best))
    return within


class Darling(Planned):
    """The learner chooses among the first actions of reasonable plans (DARLING).

    Leonetti, Iocchi and Stone 2016, "A synthesis of automated planning and reinforcement learning
    for efficient, robust decision-making", Artificial Intelligence 241. There all plans up to a
    length form a reduced state space; here the forecast gives the worth of the best plan from each
    action on, so that the restriction is made anew in each state, and applies to rewards as well.
    """

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the learner's choice among the actions of reasonable plans"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the learner's proposal among reasonable actions, with exploration."""
        return explored_among(reasonable(situation.forecast, situation.admissible), learner)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal:
        """Return the learner's choice among reasonable actions."""
        return best_among(reasonable(situation.forecast, situation.admissible), learner)

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Let the values of reasonable actions alone count after the step."""
        lesson = super().lesson(step, following)
        if following is None:
            return lesson
        return lesson._replace(allowed=reasonable(following.forecast, following.admissible))
