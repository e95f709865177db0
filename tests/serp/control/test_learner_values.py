"""No value of a learner, infinite or NaN, makes the arbiter execute what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp._util.numbers import best_of
from serp.control.arbiter import Arbiter
from serp.control.decision import Actor
from serp.control.proposers import LearnerProposer
from serp.control.protocols import Mask, Values
from serp.control.registry import find_strategy, strategy_names
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE, UNSAFE
from serp.planning.action_map import ActionMap
from serp.planning.forecast import SAFE, Forecast
from serp.settings import resolve
from tests.serp.planning.worlds import load

ACTIONS = 4
MODEL = load(
    "(define (domain four) (:predicates (unsafe)) (:functions (x))"
    + "".join(
        f"(:action a{k} :parameters () :precondition (and) :effect (and (increase (x) 1)))"
        for k in range(ACTIONS)
    )
    + ")"
)


class Wild:
    """A learner whose values are whatever was drawn."""

    def __init__(self, q: Values) -> None:
        self.q = q

    def propose_greedily(self, x: Values, base: Values | None = None) -> Proposal:
        q = self.q if base is None else self.q + base
        return Proposal(best_of(q), False, q)

    def propose(self, x: Values, explorable: Mask | None, base: Values | None = None) -> Proposal:
        return self.propose_greedily(x, base)

    def member_q(self, x: Values) -> Values:
        return np.stack([self.q, self.q])

    def target_q(self, x: Values) -> Values:
        return self.q


class Planner:
    """A planner that says what was drawn."""

    def __init__(self, value: Values, unsafe: Mask) -> None:
        flags = np.where(unsafe, APPLICABLE | UNSAFE, APPLICABLE)
        steps = np.where(unsafe, 1, SAFE)
        choice = int(np.lexsort((-value, -steps))[0])
        risk = unsafe.astype(float)
        self._forecast = Forecast(choice, value, risk, steps, np.zeros(ACTIONS), flags, 1, 0)

    def forecast(self, state: Values) -> Forecast:
        return self._forecast


wild = st.lists(
    st.sampled_from([-math.inf, math.inf, math.nan, 0.0, 1.0, -1e39]),
    min_size=ACTIONS, max_size=ACTIONS,
)  # fmt: skip
finite = st.lists(st.sampled_from([0.0, 1.0, -1e39]), min_size=ACTIONS, max_size=ACTIONS)
masks = st.lists(st.booleans(), min_size=ACTIONS, max_size=ACTIONS)


@pytest.mark.parametrize("strategy", strategy_names())
@settings(max_examples=40, deadline=None)
@given(
    q=wild,
    value=finite,
    unsafe=masks,
    after=st.sampled_from(("planner", "learner")),
    rho=st.sampled_from((0.0, 1.0)),
)
def test_no_value_of_a_learner_brings_about_what_is_refused(
    strategy: str, q: list[float], value: list[float], unsafe: list[bool], after: str, rho: float
) -> None:
    asked = resolve(
        "default", None, {"arbiter": {"rho": rho, "after_veto": after, "confidence_margin": 0.0},
                          "guide": {"strategy": strategy, "imitation_steps": 1}},
    )  # fmt: skip
    arbiter = Arbiter(
        Planner(np.array(value), np.array(unsafe)), ActionMap(MODEL, ACTIONS),
        asked.arbiter, find_strategy(strategy)(asked, 0),
    )  # fmt: skip
    with np.errstate(over="ignore", invalid="ignore"):
        learner = LearnerProposer(Wild(np.array(q, np.float32)), np.zeros(1))  # type: ignore[arg-type]
        for decide in (arbiter.decide, arbiter.decide_greedily):
            decision = decide(np.zeros(1), learner)
            if decision.admissible.any():
                assert decision.admissible[decision.action]
                assert not unsafe[decision.action]
            else:
                assert decision.executed_by is not Actor.LEARNER
