"""Algorithm 1 of the paper: the planner acts with probability 1 - ρ, and ρ grows."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from serp._util.numbers import best_of
from serp._util.saved_state import Saved
from serp.control.model_confidence import ModelConfidence
from serp.control.protocols import Proposer
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings


class Mixture(Strategy):
    """The planner acts with probability 1 - ρ, else the learner (paper, Algorithm 1).

    In the planner's turn the learner acts if all plans have the same value, or if its networks
    agree that its choice is better (`arbiter.confidence_margin`) and the model has not proven
    reliable.
    """

    reads = (
        "arbiter.rho",
        "arbiter.rho_increment",
        "arbiter.rho_unit",
        "arbiter.rho_max",
        "arbiter.confidence_margin",
        "arbiter.indifferent",
    )

    def __init__(self, settings: Settings, seed: Seed = 0, *, adapts: bool = True) -> None:
        super().__init__(settings, seed, adapts=adapts)
        self._rho = settings.arbiter.rho
        self._random = np.random.default_rng(seed)

    @property
    def rho(self) -> float:
        """ρ."""
        return self._rho

    @property
    def _learner_if_indifferent(self) -> bool:
        return self._settings.arbiter.indifferent == "learner"

    @property
    def turns(self) -> str:
        """In words: who acts with which probability."""
        if self._rho >= 1.0:
            return self.choice
        also = ["all plans are worth the same"] if self._learner_if_indifferent else []
        if self._settings.arbiter.confidence_margin is not None:
            also.append("its networks agree that their own choice is better")
        text = f"with probability {1.0 - self._rho:.2f} the planner's choice, else the learner's"
        return text + (f"; the learner's also where {' or '.join(also)}" if also else "")

    def forked(self, seed: np.random.SeedSequence) -> Mixture:
        """Return a copy with its own random draws."""
        forked = copy.copy(self)
        forked._random = np.random.default_rng(seed)
        return forked

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Draw whose turn it is; return the learner's proposal, or None."""
        planners_turn = self._random.random() > self._rho
        if planners_turn and not (self._learner_if_indifferent and situation.forecast.indifferent):
            return self._confident(situation, learner)
        explorable, admissible = situation.explorable, situation.admissible
        filtered = explorable is not None and explorable is not admissible
        if filtered and self._confident(situation, learner) is not None:
            explorable = admissible  # the learner's choice is better than the plans that filter
        return learner.propose(explorable)

    def _confident(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's greedy choice if its networks agree that it is better; else None."""
        planned, margin = situation.forecast.choice, self._settings.arbiter.confidence_margin
        if margin is None or planned < 0 or situation.confidence is not ModelConfidence.OPEN:
            return None
        q = learner.member_q()
        if len(q) < 2:
            return None
        mean = q.mean(axis=0)
        own = best_of(mean, situation.admissible)
        if own < 0 or own == planned:
            return None
        gain = q[:, own] - q[:, planned]
        if not gain.mean() > margin * gain.std():  # also for NaN
            return None
        return learner.propose_greedily(among=situation.admissible)

    def end_unit(self, unit: str) -> None:
        """Increase ρ if this is the unit by which it grows."""
        if unit == self._settings.arbiter.rho_unit:
            settings = self._settings.arbiter
            self._rho = min(settings.rho_max, self._rho + settings.rho_increment)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return {"rho": self._rho, "random": self._random.bit_generator.state}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("strategy", {}, meta)
        self._rho = saved.real("rho", 0.0, 1.0)
        self._random.bit_generator.state = saved.generator_state("random", self._random)
