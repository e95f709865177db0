"""Hand-over by evidence: the returns decide whether planner or learner acts in an episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from serp._util.saved_state import (
    Declared,
    Reader,
    Saved,
    count,
    part,
    probability,
    random,
    truths,
    within,
)
from serp.agent.decision import Decision
from serp.agent.protocols import Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, PolicyEvidence, Seed, Situation, Strategy, Worth
from serp.learning.dqn import Proposal
from serp.settings import Settings

_LARGEST: Final = 1e150
"""Larger returns have no finite square; such an episode is no evidence."""

Belief = tuple[float, float]
"""Mean and variance of an expected return."""


class Returns(Declared):
    """The returns of the episodes of one acting policy, the newest with the most weight.

    `count` is the sum of the weights, `squares` that of squared deviations from the `mean`.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {
        "episodes": count,
        "count": within(0.0),
        "mean": within(-_LARGEST, _LARGEST),
        "squares": within(0.0),
    }

    def __init__(self) -> None:
        self.count = self.mean = self.squares = 0.0
        self.episodes = 0

    def fade(self, by: float) -> None:
        """Reduce the weight of everything so far."""
        self.count *= by
        self.squares *= by

    def add(self, value: float) -> None:
        """Add a return with weight 1."""
        self.episodes += 1
        self.count += 1.0
        off = value - self.mean
        self.mean += off / self.count
        self.squares = max(0.0, self.squares + off * (value - self.mean))


class Evidence(Strategy):
    """Discounted Thompson sampling chooses planner or learner for each whole episode.

    The learner is drawn with the probability ρ that its expected return is larger (Student's t on
    the returns of each; Raj & Kalyani 2017, arXiv 1707.09727). Old returns lose weight, because
    both policies change with experience. Without evidence a policy is expected to be as bad as the
    worst episode so far, so the planner begins. Where all plans have the same value, the learner
    acts in the planner's episodes, too, and explores. It does not explore in its own episodes, so
    that their returns are those of its trained policy.
    """

    imitates = True
    STATE: ClassVar[Mapping[str, Reader]] = {
        "planner": part,
        "learner": part,
        "_leads": truths,
        "_worst": within(-_LARGEST, math.inf),
        "_best": within(-math.inf, _LARGEST),
        "_steps": count,
        "_rho": probability,
        "_random": random,
    }

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self.planner, self.learner = Returns(), Returns()
        self._leads = [False] * settings.training.num_envs
        """Whether the learner leads the current episode of each environment."""
        self._worst, self._best = math.inf, -math.inf
        self._steps = 0
        self._rho = 0.0

    @property
    def rho(self) -> float:
        """ρ, the probability that the learner's episodes are worth more than the planner's."""
        return self._rho

    @property
    def imitation_weight(self) -> float:
        """Weight of the imitation loss: the probability that the planner is the better one."""
        return 1.0 - self._rho

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Add the planner's choice, to be imitated where it leads and has a reason."""
        lesson, forecast = super().lesson(step, following), step.decision.forecast
        if self._leads[self.env_index] or forecast.indifferent:
            return lesson
        return lesson._replace(imitated=forecast.choice)

    @property
    def evidence(self) -> PolicyEvidence:
        """What the episodes of planner and learner are worth."""
        planner, learner = self._beliefs()
        return PolicyEvidence(
            self._worth(self.planner, planner), self._worth(self.learner, learner), self._rho
        )

    def _worth(self, led: Returns, belief: Belief) -> Worth | None:
        if not led.episodes:
            return None
        mean, variance = belief
        span = self._best - self._worst
        return Worth(self._worst + mean * span, math.sqrt(variance) * span, led.episodes)

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        if self._rho > 0.5:
            return "the learner's choice"
        return "the planner's choice, or the learner's if all plans have the same value"

    def _beliefs(self) -> list[Belief]:
        """Return mean and variance of the expected return of the planner, and of the learner.

        The unit is the range of all returns, from 0 for the worst to 1 for the best. The prior has
        mean 0 and variance 1, and the range counts as one return's evidence on how much they vary.
        """
        span = self._best - self._worst or 1.0
        squares = (self.planner.squares + self.learner.squares) / span / span
        noise = (squares + 1.0 / 12.0) / self._freedom

        def belief(led: Returns) -> Belief:
            share = led.count / (led.count + noise)
            return share * (led.mean - self._worst) / span, 1.0 - share

        return [belief(self.planner), belief(self.learner)]

    @property
    def _freedom(self) -> float:
        """Degrees of freedom: returns that say how much returns vary."""
        return self.planner.count + self.learner.count + 1.0

    @property
    def _episodes(self) -> int:
        return self.planner.episodes + self.learner.episodes

    def _probability(self) -> float:
        """Return the probability that the learner is better."""
        episodes = self._episodes
        if not episodes or self._steps <= self._settings.learner.learning_starts:
            return 0.0  # the learner has learned nothing yet
        if not self._best - self._worst > 1e-9 * max(abs(self._best), abs(self._worst)):
            # All returns are equal. By Laplace's rule of succession the next one differs with
            # probability 1 / (n + 2), and is better as probably as worse.
            return 0.5 / (episodes + 2.0)
        from scipy.special import stdtr  # takes a while to load, and a decision needs it rarely

        (mean, variance), (other, more) = self._beliefs()
        return float(stdtr(self._freedom, (other - mean) / math.sqrt(variance + more)))

    def needs_plan(self, *, greedily: bool = False) -> bool:
        """Return whether the planner leads."""
        return self._rho <= 0.5 if greedily else not self._leads[self.env_index]

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the learner's choice if it leads; if not, its proposal where plans are alike."""
        if self._leads[self.env_index]:
            return learner.propose_greedily()
        return learner.propose(situation.admissible) if situation.forecast.indifferent else None

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the proposal of the better policy, without exploration or random draws."""
        if self._rho > 0.5 or situation.forecast.indifferent:
            return learner.propose_greedily()
        return None

    def end_episode(self, return_: float, length: int) -> None:
        """Add the return to the evidence, and draw who leads the next episode."""
        if abs(return_) <= _LARGEST:
            self._steps += length
            before = self._episodes
            # The k-th of n episodes has the weight (k / n)²: the evidence is as recent as that of
            # the newer half of all episodes alone.
            for led in (self.planner, self.learner):
                led.fade((before / (before + 1)) ** 2)
            self._worst, self._best = min(self._worst, return_), max(self._best, return_)
            (self.learner if self._leads[self.env_index] else self.planner).add(return_)
            self._rho = self._probability()
        self._leads[self.env_index] = bool(self._random.random() < self._rho)

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` where returns do not fit together."""
        super().load_state_dict(meta)
        low, high = self._worst, self._best
        fits = (low <= high) == (self._episodes > 0)
        slack = 1e-9 * max(abs(low), abs(high)) if low <= high else 0.0
        for led in (self.planner, self.learner):
            inside = low - slack <= led.mean <= high + slack if led.episodes else led.mean == 0.0
            fits = fits and inside and led.count <= led.episodes
        if not fits:
            raise Saved("strategy", {}, meta).wrong("returns do not match their count and range")
