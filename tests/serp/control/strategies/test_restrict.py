"""Restrict: whatever is chosen or explored has a plan that is nearly as good as the best."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from serp.control.strategies.restrict import Restrict
from tests.serp.control.strategies.scene import Known, guide, situation


@pytest.mark.parametrize(
    ("values", "slack", "reasonable"),
    [
        ([10.0, 8.0, 7.9, -5.0], 0.2, [True, True, False, False]),
        ([-10.0, -12.0, -12.1, 0.0], 0.2, [False, False, False, True]),
        ([-10.0, -12.0, -12.1], 0.2, [True, True, False]),
        ([0.0, 0.0, -0.1], 5.0, [True, True, False]),
        ([1.0, 1.0, 0.999], 0.0, [True, True, False]),
    ],
)
def test_an_action_is_reasonable_within_a_share_of_the_best_plans_worth(
    values: list[float], slack: float, reasonable: list[bool]
) -> None:
    seen = situation(values)
    strategy = Restrict(guide(restrict_slack=slack))
    assert strategy.allowed(seen.forecast, seen.admissible).tolist() == reasonable


def test_what_is_refused_sets_no_mark_and_is_not_reasonable() -> None:
    seen = situation([100.0, 10.0, 9.0, 1.0], admissible=[False, True, True, True])
    allowed = Restrict(guide(restrict_slack=0.2)).allowed(seen.forecast, seen.admissible)
    assert allowed.tolist() == [False, True, True, False]


def test_choice_exploration_and_value_of_the_next_state_are_all_restricted() -> None:
    random = Random(0)
    for _ in range(100):
        strategy = Restrict(guide(restrict_slack=random.choice((0.0, 0.2, 1.0))))
        admissible = [random.random() < 0.7 for _ in range(5)]
        seen = situation([random.gauss(0, 2) for _ in range(5)], admissible)
        learner = Known([random.random() for _ in range(5)])
        allowed = strategy.allowed(seen.forecast, seen.admissible)
        assert allowed.any() == any(admissible)
        greedy = (strategy.propose(seen, learner), strategy.propose_greedily(seen, learner))
        for proposal in greedy:
            assert proposal.action == int(np.where(allowed, learner.q, -np.inf).argmax()) or (
                not allowed.any()
            )
        assert learner.explorable is not None
        assert learner.explorable.tolist() == allowed.tolist()
        assert learner.among is not None
        assert learner.among.tolist() == allowed.tolist()


@pytest.mark.parametrize("slack", [0.0, 0.2])
def test_actions_that_the_model_does_not_know_are_reasonable_where_there_are_no_others(
    slack: float,
) -> None:
    seen = situation([1.0, -np.inf, -np.inf], admissible=[True, True, True])
    strategy = Restrict(guide(restrict_slack=slack))
    assert strategy.allowed(seen.forecast, seen.admissible).tolist() == [True, False, False]
    only = np.array([False, True, True])
    assert strategy.allowed(seen.forecast, only).tolist() == [False, True, True]
