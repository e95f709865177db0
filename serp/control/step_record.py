"""The record of an env step, and the totals of an episode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from serp.control.decision import Decision
from serp.control.decision_counts import DecisionCounts
from serp.model.transition_model import Vector


@dataclass(slots=True)
class EpisodeTotals:
    """The totals of an episode: sums of rewards by their source, and counts of its steps.

    `unsafe_observed` and `avoidable_unsafe` count the steps for which `StepRecord.unsafe_observed`
    and `Decision.avoidable_unsafe` hold.
    """

    length: int = 0
    return_: float = 0.0
    domain_return: float = 0.0
    learner_return: float = 0.0
    terminated: bool = False
    truncated: bool = False
    unsafe_observed: int = 0
    avoidable_unsafe: int = 0
    decisions: DecisionCounts = field(default_factory=DecisionCounts)

    def add(self, step: StepRecord) -> None:
        """Add a step."""
        self.length = step.number
        self.return_ += step.env_reward
        self.domain_return += step.domain_reward
        self.learner_return += step.reward
        self.terminated, self.truncated = step.terminated, step.truncated
        self.unsafe_observed += step.unsafe_observed
        self.avoidable_unsafe += step.decision.avoidable_unsafe
        self.decisions.count(step.decision)


class StepRecord(NamedTuple):
    """One env step.

    Training, evaluation, comparison and films all read it; there is one for every env step.

    Attributes:
        number: Number of the step in its episode, from 1.
        observation: The environment's observation before the step, unchanged.
        state: State `[F]` that the observation was grounded to.
        x: The learner's input before the step.
        decision: The decision.
        reward: The reward that is learned from; the environment's in an evaluation.
        domain_reward: R(s′) of the domain file; 0 if it gives none.
        env_reward: The environment's reward.
        unsafe: Whether the observed step is unsafe by the domain file.
        unsafe_observed: Whether it came out unsafe, by the domain file or by the environment, whose
            info may have `unsafe` as true: harm that no observation need show.
        next_state: State `[F]` after the step.
        next_x: The learner's input after the step.
        terminated: Whether the environment ended the episode.
        truncated: Whether the environment or the limit on steps cut the episode off.
        info: The environment's info.
        episode: The totals of the episode up to and including this step. All steps of an episode
            share this object, so it is valid until the next step.
    """

    number: int
    observation: Any
    state: Vector
    x: Vector
    decision: Decision
    reward: float
    domain_reward: float
    env_reward: float
    unsafe: bool
    unsafe_observed: bool
    next_state: Vector
    next_x: Vector
    terminated: bool
    truncated: bool
    info: dict[str, Any]
    episode: EpisodeTotals

    @property
    def last(self) -> bool:
        """Whether the episode ended with this step."""
        return self.terminated or self.truncated

    @property
    def ground(self) -> int:
        """Ground action that was executed; -1 if the model does not know it."""
        return int(self.decision.forecast.ground[self.decision.action])


OnStep = Callable[[StepRecord], None]
"""Called with every env step, after learning from it."""
