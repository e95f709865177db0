"""Residual: what the network does not add is the planner's."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from serp.control.strategies.residual import Residual
from serp.settings import Settings
from tests.serp.control.scene import Known, forecast, situation, told


def residual(scale: float) -> Residual:
    return Residual(Settings().replace({"learner": {"reward_scale": scale}}))


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_a_network_that_adds_nothing_leaves_the_planners_choice(scale: float) -> None:
    random, strategy = Random(0), residual(scale)
    for _ in range(100):
        seen = situation([random.gauss(0, 5) for _ in range(4)])
        learner = Known([0.0] * 4)
        for proposal in (
            strategy.propose(seen, learner),
            strategy.propose_greedily(seen, learner),
            strategy.propose_baseline(seen, learner),
        ):
            assert proposal.action == seen.forecast.choice
            assert proposal.q == pytest.approx(scale * seen.forecast.value)


def test_what_the_network_adds_decides_where_it_is_more_than_the_planners_difference() -> None:
    strategy, seen = residual(0.5), situation([4.0, 0.0])
    assert strategy.propose_greedily(seen, Known([0.0, 1.9])).action == 0
    assert strategy.propose_greedily(seen, Known([0.0, 2.1])).action == 1


def test_an_action_without_a_value_counts_as_the_least_of_the_others() -> None:
    strategy = residual(1.0)
    assert strategy.base(forecast([3.0, -np.inf, 1.0])).tolist() == [3.0, 1.0, 1.0]
    assert strategy.base(forecast([-np.inf, -np.inf])).tolist() == [0.0, 0.0]


def test_the_learner_is_told_the_planners_values_of_both_states() -> None:
    said = told(residual(0.5), 0, [2.0, 4.0], [6.0, 8.0])
    assert (said.action, said.value, said.next_values.tolist()) == (-1, 1.0, [3.0, 4.0])
    ended = told(residual(0.5), 1, [2.0, 4.0])
    assert (ended.value, ended.next_values.tolist()) == (2.0, [0.0, 0.0])
