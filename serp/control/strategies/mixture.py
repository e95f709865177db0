"""Algorithm 1 of the paper: the planner acts with probability 1 - ρ, and ρ grows."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from serp._util.saved_state import Saved
from serp.control.protocols import Proposer
from serp.control.strategies.strategy import Seed, Situation, Strategy
from serp.learning.dqn import Proposal
from serp.settings import Settings


class Mixture(Strategy):
    """The planner acts with probability 1 - ρ, else the learner (paper, Algorithm 1).

    The learner explores among all actions; its proposals may be refused.
    """

    reads = ("arbiter.rho", "arbiter.rho_increment", "arbiter.rho_unit")

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._rho = settings.arbiter.rho
        self._random = np.random.default_rng(seed)

    @property
    def rho(self) -> float:
        """ρ."""
        return self._rho

    @property
    def turns(self) -> str:
        """In words: who acts with which probability."""
        if self._rho >= 1.0:
            return self.choice
        return f"with probability {1.0 - self._rho:.2f} the planner's choice, else the learner's"

    def forked(self, seed: np.random.SeedSequence) -> Mixture:
        """Return a copy with its own random draws."""
        forked = copy.copy(self)
        forked._random = np.random.default_rng(seed)
        return forked

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Draw whose turn it is; return the learner's proposal, or None."""
        return None if self._random.random() > self._rho else learner.propose(None)

    def end_unit(self, unit: str) -> None:
        """Increase ρ if this is the unit by which it grows."""
        if unit == self._settings.arbiter.rho_unit:
            self._rho = min(1.0, self._rho + self._settings.arbiter.rho_increment)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        return {"rho": self._rho, "random": self._random.bit_generator.state}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("strategy", {}, meta)
        self._rho = saved.real("rho", 0.0, 1.0)
        self._random.bit_generator.state = saved.generator_state("random", self._random)
