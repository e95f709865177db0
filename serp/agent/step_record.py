"""The record of an env step, and the totals of an episode."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, NamedTuple

from serp._util.saved_state import Declared, Reader, count, counts_of
from serp.agent.decision import Actor, Decision, Reason
from serp.model.transition_model import Vector

STEPS_BY: Final[Mapping[str, str]] = {actor.value: f"{actor.value}_steps" for actor in Actor}
"""Actor → name of the count of steps in which its action was executed."""

SAFETY: Final = ("vetoes", "unsafe_predicted", "unsafe_executed", "no_safe_action")
_SIGHT: Final = {
    "saw_all": ("exhausted",),
    "by_cells": ("cells", "unknown"),
    "cut_short": ("nodes",),
    "safety_alone": ("safety",),
}
"""Name of a count → the bounds of the planner's sight that it counts: names of `Bound`."""
_SIGHT_OF: Final = {bound: name for name, bounds in _SIGHT.items() for bound in bounds}
_SUMS: Final = (*SAFETY[1:], *_SIGHT, "layers_seen", "indifferent")


class DecisionCounts(Declared):
    """Counts over steps.

    Attributes:
        executed: Actor → steps in which its action was executed. They add up to `steps`.
        refused: Reason → proposals refused for it. They add up to `vetoes`.
        unsafe_predicted: Proposals that the domain file flags unsafe, or that are too risky.
        unsafe_executed: Executed actions that the domain file flags unsafe.
        no_safe_action: Steps in which every action was flagged or too risky.
        saw_all: Steps in which the planner saw everything that can be reached.
        by_cells: Steps in which values of cells stood for what lies beyond the lookahead.
        cut_short: Steps in which a budget of nodes or time ended its sight.
        safety_alone: Steps in which it was only asked which actions are safe.
        layers_seen: Layers of states that it saw, summed over the other steps in which it did not
            see everything.
        indifferent: Steps in which it had no reason to prefer one action.
    """

    STATE: ClassVar[Mapping[str, Reader]] = {
        "executed": counts_of(Actor),
        "refused": counts_of(Reason),
        **dict.fromkeys(_SUMS, count),
    }

    def __init__(self) -> None:
        self.executed: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.unsafe_predicted = self.unsafe_executed = self.no_safe_action = 0
        self.saw_all = self.by_cells = self.cut_short = self.safety_alone = 0
        self.layers_seen = self.indifferent = 0

    def count(self, step: Any) -> None:
        """Count a step, given its `Decision` or its row of `decisions.csv`."""
        reason = step.reason
        self.executed[step.executed_by] += 1
        if step.vetoed:
            self.refused[reason] += 1
        self.unsafe_predicted += step.proposal_unsafe
        self.unsafe_executed += step.unsafe
        self.no_safe_action += reason in (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK)
        sight = _SIGHT_OF.get(step.bound)
        if sight is not None:
            setattr(self, sight, getattr(self, sight) + 1)
        self.layers_seen += 0 if sight == "saw_all" else step.depth
        self.indifferent += step.indifferent

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        return self.executed.total()

    @property
    def vetoes(self) -> int:
        """Number of proposals refused."""
        return self.refused.total()

    def numbers(self) -> dict[str, int]:
        """Return every count by the name of its column in `metrics.csv`."""
        return {
            **{name: self.executed[actor] for actor, name in STEPS_BY.items()},
            "vetoes": self.vetoes,
            **{name: getattr(self, name) for name in _SUMS},
        }

    def vetoes_by_reason(self) -> dict[str, int]:
        """Return reason → proposals refused for it, the most frequent first, ties by name."""
        refused = {str(reason): count for reason, count in self.refused.items() if count}
        return dict(sorted(refused.items(), key=lambda item: (-item[1], item[0])))


NUMBERS: Final = tuple(DecisionCounts().numbers())
"""Names of all counts; they are columns of `metrics.csv`."""


def total(metrics: Mapping[str, Any]) -> dict[str, int]:
    """Return every count over all episodes, given the columns of `metrics.csv` as arrays."""
    return {name: int(metrics[name].sum()) for name in NUMBERS}


def sight_of(counts: Mapping[str, int], steps: int) -> dict[str, float | None]:
    """Return how far the planner saw: shares of steps, see `DecisionCounts`.

    All but `safety_alone` are of the steps in which it planned. `mean_depth` is the mean number of
    layers that it saw where it did not see everything.
    """
    planned = steps - counts["safety_alone"]
    shares = {
        name: counts[name] / planned if planned else None for name in (*_SIGHT, "indifferent")
    }
    shares["safety_alone"] = counts["safety_alone"] / steps if steps else None
    partial = planned - counts["saw_all"]
    return {**shares, "mean_depth": counts["layers_seen"] / partial if partial else None}


@dataclass(slots=True)
class EpisodeTotals:
    """The totals of an episode: sums of rewards by their source, and counts of its steps."""

    length: int = 0
    return_: float = 0.0
    domain_return: float = 0.0
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
