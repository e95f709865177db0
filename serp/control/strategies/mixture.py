"""Algorithm 1 of the paper: the planner acts with probability 1 - ρ, and ρ grows."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from serp._util.numbers import best_of
from serp._util.saved_state import Saved
from serp.control.model_confidence import ModelConfidence
from serp.control.strategies.advice import advice
from serp.control.strategies.strategy import Learner, Proposed, Situation, Strategy
from serp.learning.guidance import Guidance, GuidedLearning
from serp.planning.action_map import ActionForecast
from serp.settings import ArbiterSettings


class Mixture(Strategy):
    """The planner's turn with probability 1 - ρ, else the learner's (paper, Algorithm 1).

    Args:
        rho: ρ at the start, in [0, 1].
        increment: Δρ, what it gains at the end of each unit.
        unit: `step`, `episode` or the name of a counter.
        most: Largest ρ.
        ask_when_indifferent: Whether the learner is asked where all plans are worth the same.
        surety: The learner acts in the planner's turn where its networks agree that its own choice
            is better: the mean of what they see in it exceeds so many standard deviations. Not
            where the model is reliable, nor while it grows, and never for None.
        imitation: Weight of the learner's imitation loss: where the model is reliable, what the
            planner would do is to be worth a margin more than anything else (Hester et al. 2018).
            0: nothing is imitated.
        seed: Seed of the draws.
    """

    def __init__(
        self,
        *,
        rho: float,
        increment: float,
        unit: str,
        most: float,
        ask_when_indifferent: bool,
        surety: float | None = None,
        imitation: float = 0.0,
        seed: int | np.random.SeedSequence,
    ) -> None:
        if imitation > 0.0:
            self.guided = GuidedLearning(margin_weight=imitation, q_filter=False)
        self._reliable = False
        self._rho = rho
        self._increment = increment
        self._unit = unit
        self._most = most
        self._ask_when_indifferent = ask_when_indifferent
        self._surety = surety
        self._random = np.random.default_rng(seed)

    @property
    def rho(self) -> float:
        """ρ."""
        return self._rho

    @property
    def turns(self) -> str:
        """Who acts with which probability."""
        if self._rho >= 1.0:
            return self.choice
        also = ["all plans are worth the same"] * self._ask_when_indifferent
        if self._surety is not None:
            also.append("its networks agree that their own choice is better")
        text = f"with probability {1.0 - self._rho:.2f} the planner's choice, else the learner's"
        return text + (f"; the learner's also where {' or '.join(also)}" if also else "")

    def forked(self, seed: np.random.SeedSequence) -> Mixture:
        """Return a copy with draws of its own."""
        forked = copy.copy(self)
        forked._random = np.random.default_rng(seed)
        return forked

    def propose(self, situation: Situation, learner: Learner) -> Proposed | None:
        """Draw whose turn it is."""
        self._reliable = situation.trust is ModelConfidence.RELIABLE
        planners_turn = self._random.random() > self._rho
        if planners_turn and not (self._ask_when_indifferent and situation.forecast.indifferent):
            return self._sure(situation, learner)
        explorable, admissible = situation.explorable, situation.admissible
        filtered = explorable is not None and explorable is not admissible
        if filtered and self._sure(situation, learner) is not None:
            explorable = admissible  # plans that are known to mislead filter nothing
        return learner.propose(explorable)

    def _sure(self, situation: Situation, learner: Learner) -> Proposed | None:
        """Return the learner's own choice where it is sure that it is better than the planner's."""
        planned = situation.forecast.choice
        if self._surety is None or planned < 0 or situation.trust is not ModelConfidence.OPEN:
            return None
        q = learner.member_q()
        if len(q) < 2:  # nobody to agree with
            return None
        mean = q.mean(axis=0)
        own = best_of(mean, situation.admissible)
        if own < 0 or own == planned:
            return None
        gain = q[:, own] - q[:, planned]
        if not gain.mean() > self._surety * gain.std():  # NaN is no surety
            return None
        return learner.propose_greedily(among=situation.admissible)

    def guidance(
        self, forecast: ActionForecast, action: int, following: ActionForecast | None
    ) -> Guidance | None:
        """Return what the planner would have done, to be imitated where it has a reason for it."""
        if self.guided is None:
            return None
        imitate = self._reliable and not forecast.indifferent
        return advice(forecast, action, following, scale=1.0, imitate=imitate)

    def end_unit(self, unit: str) -> None:
        """Let ρ grow if it grows by this unit."""
        if unit == self._unit:
            self._rho = min(self._most, self._rho + self._increment)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return {"rho": self._rho, "random": self._random.bit_generator.state}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("strategy", {}, meta)
        self._rho = saved.real("rho", 0.0, 1.0)
        self._random.bit_generator.state = saved.generator_state("random", self._random)


def mixture_of(settings: ArbiterSettings, seed: int | np.random.SeedSequence) -> Mixture:
    """Return the strategy of Algorithm 1 with the settings of the arbiter."""
    return Mixture(
        rho=settings.rho,
        increment=settings.rho_increment,
        unit=settings.rho_unit,
        most=settings.rho_max,
        ask_when_indifferent=settings.indifferent == "learner",
        surety=settings.confidence_margin,
        imitation=settings.imitation_weight,
        seed=seed,
    )
