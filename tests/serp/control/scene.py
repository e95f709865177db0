"""A planner's view and a learner whose values are known, to see what a strategy makes of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from serp.control.protocols import Mask, Values
from serp.control.strategies.strategy import Situation, Strategy
from serp.learning.dqn import Proposal
from serp.learning.guidance import Guidance
from serp.model.flags import APPLICABLE
from serp.planning.action_map import ActionForecast
from serp.planning.forecast import SAFE
from serp.planning.limits import Bound
from serp.settings import Settings


def forecast(values: Sequence[float]) -> ActionForecast:
    """What the planner thinks of actions that are all applicable and safe."""
    value = np.array(values, dtype=np.float64)
    count = len(value)
    return ActionForecast(
        choice=int(value.argmax()),
        ground=np.arange(count),
        value=value,
        path_risk=np.zeros(count),
        safe_steps=np.full(count, SAFE),
        reward=np.zeros(count),
        flags=np.full(count, APPLICABLE),
        depth=1,
        bound=Bound.DEPTH,
        indifferent=count > 1 and bool((value == value[0]).all()),
    )


def situation(
    values: Sequence[float],
    admissible: Sequence[bool] | None = None,
) -> Situation:
    """A state in which the plans from each action on are worth so much."""
    allowed = np.ones(len(values), bool) if admissible is None else np.array(admissible)
    return Situation(forecast(values), allowed)


class Known:
    """A learner whose values are given; it explores where an action to be explored is given.

    Attributes:
        explorable, among: What it was last asked with.
    """

    def __init__(
        self,
        q: Sequence[float],
        target: Sequence[float] | None = None,
        explored: int | None = None,
    ) -> None:
        self.q = np.array(q, dtype=np.float32)
        self.target = self.q if target is None else np.array(target, dtype=np.float32)
        self.explored = explored
        self.explorable: Mask | None = None
        self.among: Mask | None = None

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        self.explorable = explorable
        if self.explored is not None:
            return Proposal(self.explored, True, None)
        return self.propose_greedily(among=among, base=base)

    def propose_greedily(
        self, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        self.among = among
        q = self.q if base is None else (self.q + base).astype(np.float32)
        choice = q if among is None or not among.any() else np.where(among, q, -np.inf)
        return Proposal(int(choice.argmax()), False, q)

    def target_q(self) -> Values:
        return self.target


def learner_acts(strategy: Strategy) -> bool:
    """Whether the learner is asked next, all else equal."""
    return strategy.propose(situation([1.0, 0.0]), Known([0.0, 1.0])) is not None


def told(strategy: Strategy, action: int, *values: Sequence[float]) -> Guidance:
    """What the learner is told after an action, of one state or two; the second is the next."""
    ahead = forecast(values[1]) if len(values) > 1 else None
    said = strategy.guidance(forecast(values[0]), action, ahead)
    assert said is not None
    return said


def guide(**values: object) -> Settings:
    """Settings with these of section `guide`."""
    return Settings().replace({"guide": values})
