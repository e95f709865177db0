"""Hand-over by evidence: an episode is led by planner or learner, as their returns suggest."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from scipy import special

from serp._util.saved_state import Saved
from serp.control.protocols import Proposer
from serp.control.strategies.imitating import ImitatingStrategy
from serp.control.strategies.strategy import Seed, Situation
from serp.learning.dqn import Proposal
from serp.settings import Settings

_MEMORY: Final = 0.95
"""Weight of the past in the evidence, per episode."""


class Returns:
    """The returns of the episodes that one of the two led, the newest with the most weight.

    Attributes:
        count: Sum of the weights.
        mean: Weighted mean.
        squares: Weighted sum of squared deviations from it.
    """

    def __init__(self) -> None:
        self.count = self.mean = self.squares = 0.0

    def fade(self) -> None:
        """Reduce the weight of everything so far."""
        self.count *= _MEMORY
        self.squares *= _MEMORY

    def add(self, value: float) -> None:
        """Add a return with weight 1."""
        self.count += 1.0
        off = value - self.mean
        self.mean += off / self.count
        self.squares += off * (value - self.mean)

    def belief(self, noise: float, low: float, high: float) -> tuple[float, float]:
        """Return mean and variance of what the expected return is believed to be.

        Without evidence it is the lowest return seen so far, within the range of all returns.

        Args:
            noise: Variance of a return.
            low: Lowest return so far.
            high: Highest return so far; above `low`.
        """
        prior, data = 1.0 / (high - low) ** 2, self.count / noise
        return (prior * low + data * self.mean) / (prior + data), 1.0 / (prior + data)


class Evidence(ImitatingStrategy):
    """Planner or learner leads a whole episode: the learner with the probability that it is better.

    That probability is ρ. It follows from the returns of the episodes that each has led; old ones
    count less, so that both are tried again from time to time (discounted Thompson sampling: Raj &
    Kalyani 2017, arXiv 1707.09727). Without evidence a lead is expected to be as bad as the worst
    episode so far, so the planner begins. While the planner leads, the learner acts where all plans
    have the same value. The trained policy is the lead that is more probably the better one.
    """

    reads = ("arbiter.imitation_weight",)

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self.planner, self.learner = Returns(), Returns()
        self._worst, self._best = math.inf, -math.inf
        self._leads = False
        self._random = np.random.default_rng(seed)

    @property
    def rho(self) -> float:
        """ρ, the probability that the learner's lead is worth more than the planner's."""
        span = self._best - self._worst
        if not span > 1e-9 * max(abs(self._best), abs(self._worst)):
            return 0.0  # there is no evidence, or all returns are equal
        planner, learner = self.planner, self.learner
        # The range counts as one return's evidence on how much returns vary.
        noise = (planner.squares + learner.squares + span**2 / 12.0) / (
            planner.count + learner.count + 1.0
        )
        mean, variance = planner.belief(noise, self._worst, self._best)
        other, more = learner.belief(noise, self._worst, self._best)
        return float(special.ndtr((other - mean) / math.sqrt(variance + more)))

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the learner's choice" if self.rho > 0.5 else "the planner's choice"

    @property
    def turns(self) -> str:
        """In words: who leads with which probability."""
        return f"the learner leads an episode with probability {self.rho:.2f}, else the planner"

    def forked(self, seed: np.random.SeedSequence) -> Evidence:
        """Return a copy that draws its own lead."""
        forked = copy.copy(self)
        forked._random = np.random.default_rng(seed)
        forked._leads = bool(forked._random.random() < self.rho)
        return forked

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's proposal if it leads, or all plans are alike; else None."""
        if self._leads or situation.forecast.indifferent:
            return learner.propose(situation.admissible)
        return None

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the proposal of the better lead, without exploration or random draws."""
        if self.rho > 0.5 or situation.forecast.indifferent:
            return learner.propose_greedily()
        return None

    def end_episode(self, return_: float, length: int) -> None:
        """Add the return to the evidence, and draw who leads the next episode."""
        self._worst, self._best = min(self._worst, return_), max(self._best, return_)
        self.planner.fade()
        self.learner.fade()
        (self.learner if self._leads else self.planner).add(return_)
        self._leads = bool(self._random.random() < self.rho)

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly, between episodes."""
        return {
            "planner": vars(self.planner).copy(),
            "learner": vars(self.learner).copy(),
            "range": [self._worst, self._best] if self._worst <= self._best else None,
            "leads": self._leads,
            "random": self._random.bit_generator.state,
        }

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("strategy", {}, meta)
        for name, returns in (("planner", self.planner), ("learner", self.learner)):
            part = Saved(name, {}, saved.part(name)[1])
            returns.count = part.real("count", 0.0, math.inf)
            returns.mean = part.real("mean", -math.inf, math.inf)
            returns.squares = part.real("squares", 0.0, math.inf)
        self._worst, self._best = math.inf, -math.inf
        if meta.get("range") is not None:
            self._worst, self._best = saved.reals("range", 2, -math.inf, math.inf)
        self._leads = saved.truth("leads")
        self._random.bit_generator.state = saved.generator_state("random", self._random)
