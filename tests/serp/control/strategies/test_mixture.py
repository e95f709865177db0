"""The mixture: whose turn it is, drawn with ρ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from serp.control.model_confidence import ModelConfidence
from serp.control.strategies.mixture import Mixture
from serp.settings import Settings
from tests.serp.control.scene import Known, learner_acts, situation

SURE = Known([0.2, 1.2, 0.0], members=[[0.1, 1.0, 0.0], [0.3, 1.4, 0.0]])
"""Its networks agree that action 1 is the best."""


def mixture(rho: float, *, seed: int = 0, **settings: Any) -> Mixture:
    given = {"rho_increment": 0.25, "rho_unit": "game", "rho_max": max(0.9, rho), **settings}
    return Mixture(Settings().replace({"arbiter": {"rho": rho, **given}}), seed)


def test_rho_is_the_learners_share() -> None:
    strategy = mixture(0.3)
    share = np.mean([learner_acts(strategy) for _ in range(5_000)])
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 5_000)


def test_rho_grows_by_its_unit_to_its_maximum() -> None:
    strategy = mixture(0.1)
    for unit, rho in (("step", 0.1), ("episode", 0.1), ("game", 0.35), ("game", 0.6)):
        strategy.end_unit(unit)
        assert strategy.rho == rho
    strategy.end_unit("game")
    strategy.end_unit("game")
    assert strategy.rho == 0.9


def test_the_planners_turn_is_the_learners_where_all_plans_are_alike() -> None:
    alike = situation([1.0, 1.0])
    assert mixture(0.0).propose(alike, Known([0.0, 1.0])) is not None
    strict = mixture(0.0, indifferent="first")
    assert strict.propose(alike, Known([0.0, 1.0])) is None


def test_a_proposal_is_drawn_for_whether_or_not_the_planner_is_indifferent() -> None:
    """So that what is drawn later does not depend on it."""
    one, other = mixture(0.5), mixture(0.5)
    one.propose(situation([1.0, 1.0]), Known([0.0, 1.0]))
    other.propose(situation([1.0, 0.0]), Known([0.0, 1.0]))
    assert one.state_dict() == other.state_dict()


def test_a_learner_that_is_sure_acts_in_the_planners_turn() -> None:
    """Its networks have to agree that its own choice is better than the planner's."""
    seen = situation([1.0, 0.0, 0.0])
    proposal = mixture(0.0, confidence_margin=3.0).propose(seen, SURE)
    assert proposal is not None
    assert (proposal.action, proposal.exploratory) == (1, False)
    assert mixture(0.0, confidence_margin=None).propose(seen, SURE) is None
    for learner in (
        Known([0.2, 1.2, 0.0], members=[[0.1, 3.0, 0.0], [0.3, -0.6, 0.0]]),  # they differ
        Known([1.2, 0.2, 0.0], members=[[1.1, 0.2, 0.0], [1.3, 0.2, 0.0]]),  # the planner's is best
        Known([0.2, 1.2, 0.0], members=[[0.2, 1.2, 0.0]]),  # nobody to agree with
    ):
        assert mixture(0.0, confidence_margin=3.0).propose(seen, learner) is None
    refused = situation([1.0, 0.0, 0.0], admissible=[True, False, True])
    assert mixture(0.0, confidence_margin=1.0).propose(refused, SURE) is None


@pytest.mark.parametrize("confidence", ModelConfidence)
def test_a_learner_that_is_sure_acts_only_where_nothing_is_known_of_the_model(
    confidence: ModelConfidence,
) -> None:
    strategy = mixture(0.0, confidence_margin=3.0)
    proposal = strategy.propose(situation([1.0, 0.0, 0.0], confidence=confidence), SURE)
    assert (proposal is not None) == (confidence is ModelConfidence.OPEN)
