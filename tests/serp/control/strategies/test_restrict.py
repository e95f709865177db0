"""Restrict: whatever is chosen or explored has a plan that is nearly as good as the best."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from serp.control.strategies.restrict import Restrict
from tests.serp.control.scene import Known, guide, situation

NONE = -np.inf
"""The value of an action that the model does not know."""


@pytest.mark.parametrize(
    ("values", "admissible", "slack", "reasonable"),
    [
        ([10.0, 8.0, 7.9, -5.0], "1111", 0.2, "1100"),
        ([-10.0, -12.0, -12.1, 0.0], "1111", 0.2, "0001"),
        ([-10.0, -12.0, -12.1], "111", 0.2, "110"),
        ([0.0, 0.0, -0.1], "111", 5.0, "110"),
        ([1.0, 1.0, 0.999], "111", 0.0, "110"),
        ([100.0, 10.0, 9.0, 1.0], "0111", 0.2, "0110"),  # what is refused sets no mark
        ([1.0, NONE, NONE], "111", 0.2, "100"),
        ([1.0, NONE, NONE], "011", 0.0, "011"),  # there are no others
    ],
)
def test_an_action_is_reasonable_within_a_share_of_the_best_plans_worth(
    values: list[float], admissible: str, slack: float, reasonable: str
) -> None:
    seen = situation(values, [bit == "1" for bit in admissible])
    allowed = Restrict(guide(restrict_slack=slack)).allowed(seen.forecast, seen.admissible)
    assert "".join(str(int(one)) for one in allowed) == reasonable


def test_choice_exploration_and_value_of_the_next_state_are_all_restricted() -> None:
    random = Random(0)
    for _ in range(100):
        strategy = Restrict(guide(restrict_slack=random.choice((0.0, 0.2, 1.0))))
        admissible = [random.random() < 0.7 for _ in range(5)]
        seen = situation([random.gauss(0, 2) for _ in range(5)], admissible)
        learner = Known([random.random() for _ in range(5)])
        allowed = strategy.allowed(seen.forecast, seen.admissible)
        assert allowed.any() == any(admissible)
        for proposal in (strategy.propose(seen, learner), strategy.propose_greedily(seen, learner)):
            assert learner.among is not None and learner.explorable is not None
            assert learner.among.tolist() == learner.explorable.tolist() == allowed.tolist()
            best = int(np.where(allowed, learner.q, -np.inf).argmax())
            assert proposal.action == best or not allowed.any()
