"""DQfD's margin: the planner demonstrates, and a margin holds the learner to what it saw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from serp._util.saved_state import Reader, count
from serp.agent.decision import Actor, Decision
from serp.agent.protocols import Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings


class Demonstrations(Strategy):
    """The planner demonstrates; then the learner acts, tied to the planner by a margin (DQfD).

    Hester et al. 2018, "Deep Q-learning from demonstrations", AAAI, arXiv 1704.03732: on what was
    demonstrated, the planner's action is to be worth a margin more than any other, beside the loss
    of the rewards, for the whole training. The demonstrations are the first
    `learner.epsilon_steps` steps of the training. The margin alone is taken over: the memory has no
    priorities and keeps no demonstration for ever, and no training comes before the first step.
    """

    imitates = True
    STATE: ClassVar[Mapping[str, Reader]] = {"_step": count}

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._step = 0

    @property
    def _demonstrating(self) -> bool:
        return self._step < self._settings.learner.epsilon_steps

    @property
    def rho(self) -> float:
        """0 during the demonstrations, then 1."""
        return float(not self._demonstrating)

    @property
    def imitation_weight(self) -> float:
        """1: the margin holds for the whole training."""
        return 1.0

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether the planner demonstrates."""
        return self._demonstrating and not greedily

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Let the planner demonstrate at first; then ask the learner."""
        if not self._demonstrating:
            return learner.propose(situation.admissible)
        self._step += 1
        return None

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Add the planner's choice where the planner executed it."""
        lesson, decision = super().lesson(step, following), step.decision
        planner = decision.proposed_by is Actor.PLANNER
        shown = planner and decision.action == decision.forecast.choice
        return lesson._replace(imitated=decision.action) if shown else lesson
