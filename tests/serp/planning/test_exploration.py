"""Without a word on dynamics in its file, the planner finds what the file promises far away."""

from __future__ import annotations

import numpy as np
import pytest

from serp.agent.registry import far_sight
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.transitions import GOES_ON
from serp.planning.far_sight import FarSightPlanner
from serp.settings import AdaptationSettings, PlannerSettings
from tests.serp.planning.worlds import load

TRACK = """
(define (domain track)
  (:predicates (terminal))
  (:functions (place) (speed) (reward))
  (:action left :parameters () :precondition (and) :effect (and{cost}))
  (:action wait :parameters () :precondition (and) :effect (and))
  (:action right :parameters () :precondition (and) :effect (and{cost}))
  (:event time :parameters () :precondition (and (< (place) 4))
    :effect (and (decrease (reward) {time})))
  (:event top :parameters () :precondition (and (>= (place) 4))
    :effect (and (increase (reward) {prize}) (terminal))))
"""
COST = " (decrease (reward) {})"


@pytest.mark.parametrize(
    ("cost", "time", "prize"), [(0.1, 0, 100), (0.02, 0, 1), (0.0, 1, 0), (0.0, 0, 1)]
)
def test_a_prize_that_was_never_seen_is_found_whatever_acting_costs(
    cost: float, time: float, prize: float
) -> None:
    text = TRACK.format(cost=COST.format(cost) if cost else "", time=time, prize=prize)
    adaptation = ModelAdaptation(
        load(text), AdaptationSettings(mode="residual"), np.random.SeedSequence(0)
    )
    planner = far_sight(adaptation.model, PlannerSettings())
    assert isinstance(planner, FarSightPlanner)
    planner.visited = adaptation.experience
    state, random = np.zeros(2), np.random.default_rng(0)
    for step in range(800):
        # At first a robot tries what its actions do.
        action = planner.forecast(state).choice if step > 40 else int(random.integers(3))
        place, speed = state
        speed += 0.02 * (action - 1) - 0.01 * np.sin(2.0 * place)
        after = np.array([place + 0.5 * speed, 0.98 * speed])
        if after[0] >= 4.0:
            return
        adaptation.observe(state, action, after, GOES_ON)
        state = after
    pytest.fail(f"not found; the last place is {state[0]:.2f}")
