"""LOKI: the planner is imitated for a random time, then reinforcement learning goes on alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from serp._util.saved_state import Reader, count, random
from serp.agent.decision import Decision
from serp.agent.protocols import Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings


class Loki(Strategy):
    """The learner imitates the planner for some time, then learns from rewards alone (LOKI).

    Cheng, Yan, Wagener and Boots 2018, "Fast policy learning through imitation and reinforcement",
    UAI, arXiv 1805.10413: K is drawn uniformly from [N / 2, N], here with N =
    `learner.epsilon_steps`. Imitation is online, as in DAgger (Ross, Gordon and Bagnell 2011, arXiv
    1011.0686): the planner acts with a probability that falls from 1 to 0 over the K steps, else
    the learner's greedy choice, and the planner says in every state what it would do. There mirror
    descent follows the gradient of the imitation alone; here a DQN has the loss of its imitation
    beside that of its rewards, and after K steps the latter alone.
    """

    imitates = True
    STATE: ClassVar[Mapping[str, Reader]] = {"_step": count, "_end": count, "_random": random}

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        most = settings.learner.epsilon_steps
        self._step, self._end = 0, int(self._random.integers(most // 2, most + 1))

    @property
    def imitation_steps(self) -> int:
        """K."""
        return self._end

    @property
    def _imitating(self) -> bool:
        return self._step < self._end

    @property
    def rho(self) -> float:
        """The learner's share of the decisions."""
        return self._step / self._end if self._imitating else 1.0

    @property
    def imitation_weight(self) -> float:
        """1 during the imitation, then 0."""
        return float(self._imitating)

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether the planner is imitated: it then says what to do in every state."""
        return self._imitating and not greedily

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Draw whose turn it is during the imitation; then ask the learner."""
        if not self._imitating:
            return learner.propose(situation.admissible)
        planner = self._random.random() >= self.rho
        self._step += 1
        return None if planner else learner.propose_greedily()

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Add the planner's choice in the state before the step, during the imitation."""
        lesson, forecast = super().lesson(step, following), step.decision.forecast
        return lesson._replace(imitated=forecast.choice) if self._imitating else lesson
