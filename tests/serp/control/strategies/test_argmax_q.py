"""Argmax over both proposals: the better one by the target network is executed."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from serp.control.strategies.argmax_q import ArgmaxQ
from serp.settings import Settings
from tests.serp.control.scene import Known, situation, told

STRATEGY = ArgmaxQ(Settings())


@pytest.mark.parametrize("greedily", [False, True])
def test_the_better_of_both_proposals_by_the_target_network_is_taken(greedily: bool) -> None:
    random, taken = Random(0), set()
    for _ in range(300):
        seen = situation([random.random() for _ in range(4)])
        explored = None if greedily or random.random() < 0.7 else random.randrange(4)
        q = [random.random() for _ in range(4)]
        target = [random.choice((0.0, 0.5, 1.0)) for _ in range(4)]
        learner = Known(q, target, explored)
        proposed = int(np.argmax(q)) if explored is None else explored
        answer = (STRATEGY.propose_greedily if greedily else STRATEGY.propose)(seen, learner)
        if target[seen.forecast.choice] >= target[proposed]:  # of equals, the planner
            assert answer is None
        else:
            assert answer is not None
            assert (answer.action, answer.exploratory) == (proposed, explored is not None)
        assert greedily or learner.explorable is seen.admissible
        taken.add(answer is None)
    assert taken == {True, False}


def test_a_plan_that_is_refused_or_none_at_all_is_no_proposal() -> None:
    learner = Known([0.0, 1.0], [5.0, 0.0])
    refused = situation([1.0, 0.0], admissible=[False, True])
    none = refused._replace(forecast=refused.forecast._replace(choice=-1))
    for seen in (refused, none):
        answer = STRATEGY.propose_greedily(seen, learner)
        assert answer is not None
        assert answer.action == 1


def test_the_next_states_candidate_is_the_planners_choice_there() -> None:
    said = told(STRATEGY, 0, [0.0, 1.0], [3.0, 2.0])
    assert (said.action, said.next_action) == (-1, 0)
    assert told(STRATEGY, 0, [0.0, 1.0]).next_action == -1
