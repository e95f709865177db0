"""Imitation of the planner, then reinforcement learning (LOKI, Cheng et al. 2018)."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from serp._util.saved_state import Saved
from serp.control.protocols import Proposer
from serp.control.strategies.advice import advice
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast
from serp.settings import Settings


class ImitateThenLearn(Strategy):
    """K env steps of imitation, then reinforcement learning only.

    LOKI (Cheng et al. 2018, arXiv 1805.10413): K is drawn uniformly from the second half of
    `guide.imitation_steps`. Imitation is online, as in DAgger (Ross et al. 2011, arXiv 1011.0686):
    the planner acts with a probability that falls from 1 to 0 over the K steps, else the learner's
    greedy choice is executed. In these K steps the planner's choice in every state is learned by
    DQfD's margin loss, in addition to the TD loss.
    """

    reads = ("guide.imitation_steps", "guide.margin")

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        margin, steps = settings.guide.margin, settings.guide.imitation_steps
        self.guided = GuidedLearning(margin=margin, margin_weight=1.0, q_filter=False)
        self._random = np.random.default_rng(seed)
        self._end = int(self._random.integers(steps // 2, steps + 1))
        self._step = 0

    @property
    def _imitating(self) -> bool:
        return self._step < self._end

    @property
    def rho(self) -> float:
        """The probability that the learner acts."""
        return self._step / self._end if self._imitating else 1.0

    @property
    def turns(self) -> str:
        """In words: who acts with which probability."""
        if not self._imitating:
            return self.choice
        return f"with probability {1.0 - self.rho:.2f} the planner's choice, else the learner's"

    def forked(self, seed: np.random.SeedSequence) -> ImitateThenLearn:
        """Return a copy with its own random draws."""
        forked = copy.copy(self)
        forked._random = np.random.default_rng(seed)
        return forked

    @property
    def margin_weight(self) -> float:
        """1 during imitation, then 0."""
        return float(self._imitating)

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Draw who acts during imitation; then return the learner's proposal."""
        if not self._imitating:
            return learner.propose(situation.admissible)
        return None if self._random.random() > self.rho else learner.propose_greedily()

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return the planner's choice, to be imitated."""
        return advice(forecast, action, following, scale=1.0, imitate=self._imitating)

    def end_unit(self, unit: str) -> None:
        """Count env steps."""
        self._step += unit == "step"

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return {
            "step": self._step,
            "end": self._end,
            "random": self._random.bit_generator.state,
        }

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("strategy", {}, meta)
        self._step, self._end = saved.whole("step"), saved.whole("end")
        self._random.bit_generator.state = saved.generator_state("random", self._random)
