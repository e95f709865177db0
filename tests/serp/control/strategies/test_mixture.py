"""The mixture: whose turn it is, drawn with ρ."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from serp.control.model_confidence import ModelConfidence
from serp.control.strategies.mixture import Mixture
from serp.settings import Settings
from tests.serp.control.strategies.scene import Known, learner_acts, situation


def mixture(rho: float, *, seed: int = 0, **settings: Any) -> Mixture:
    given = {"rho_increment": 0.25, "rho_unit": "game", "rho_max": max(0.9, rho), **settings}
    return Mixture(Settings().replace({"arbiter": {"rho": rho, **given}}), seed)


def test_nobody_draws_the_impossible() -> None:
    assert not any(learner_acts(mixture(0.0, seed=seed)) for seed in range(200))
    assert all(learner_acts(mixture(1.0, seed=seed)) for seed in range(200))


def test_rho_is_the_learners_share() -> None:
    strategy = mixture(0.3)
    share = np.mean([learner_acts(strategy) for _ in range(5_000)])
    assert abs(share - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 5_000)


def test_the_planners_turn_is_the_learners_where_all_plans_are_alike() -> None:
    alike = situation([1.0, 1.0])
    assert mixture(0.0).propose(alike, Known([0.0, 1.0])) is not None
    strict = mixture(0.0, indifferent="first")
    assert strict.propose(alike, Known([0.0, 1.0])) is None


def test_a_proposal_is_drawn_for_whether_or_not_the_planner_is_indifferent() -> None:
    """So that what is drawn later does not hang on it."""
    one, other = mixture(0.5), mixture(0.5)
    one.propose(situation([1.0, 1.0]), Known([0.0, 1.0]))
    other.propose(situation([1.0, 0.0]), Known([0.0, 1.0]))
    assert one.state_dict() == other.state_dict()


def test_the_trained_policy_draws_nothing() -> None:
    strategy = mixture(0.0)
    before = json.dumps(strategy.state_dict())
    assert strategy.propose_greedily(situation([1.0, 0.0]), Known([0.0, 1.0])) is not None
    assert json.dumps(strategy.state_dict()) == before


def test_a_learner_that_is_sure_acts_in_the_planners_turn() -> None:
    """Its networks have to agree that its own choice is better than the planner's."""
    seen = situation([1.0, 0.0, 0.0])
    agreed = Known([0.2, 1.2, 0.0], members=[[0.1, 1.0, 0.0], [0.3, 1.4, 0.0]])
    proposal = mixture(0.0, confidence_margin=3.0).propose(seen, agreed)
    assert proposal is not None
    assert (proposal.action, proposal.exploratory) == (1, False)
    assert mixture(0.0, confidence_margin=None).propose(seen, agreed) is None
    for learner in (
        Known([0.2, 1.2, 0.0], members=[[0.1, 3.0, 0.0], [0.3, -0.6, 0.0]]),  # they differ
        Known([1.2, 0.2, 0.0], members=[[1.1, 0.2, 0.0], [1.3, 0.2, 0.0]]),  # the planner's is best
        Known([0.2, 1.2, 0.0], members=[[0.2, 1.2, 0.0]]),  # nobody to agree with
    ):
        assert mixture(0.0, confidence_margin=3.0).propose(seen, learner) is None


@pytest.mark.parametrize("trust", [ModelConfidence.GROWING, ModelConfidence.RELIABLE])
def test_a_model_that_grows_or_has_proven_right_keeps_the_planners_turn(
    trust: ModelConfidence,
) -> None:
    seen = situation([1.0, 0.0, 0.0])
    agreed = Known([0.2, 1.2, 0.0], members=[[0.1, 1.0, 0.0], [0.3, 1.4, 0.0]])
    assert mixture(0.0, confidence_margin=3.0).propose(seen, agreed) is not None
    assert (
        mixture(0.0, confidence_margin=3.0).propose(seen._replace(confidence=trust), agreed) is None
    )


def test_only_a_model_that_has_proven_right_is_imitated() -> None:
    strategy = mixture(0.0, imitation_weight=1.0)
    seen = situation([1.0, 0.0])
    for trust in ModelConfidence:
        strategy.propose(seen._replace(confidence=trust), Known([0.0, 1.0]))
        guidance = strategy.guidance(seen.forecast, 0, seen.forecast)
        assert guidance is not None
        assert (guidance.action >= 0) == (trust is ModelConfidence.RELIABLE)


@pytest.mark.parametrize("indifferent", ["first", "learner"])
def test_a_planner_without_a_reason_is_not_imitated(indifferent: str) -> None:
    """However reliable its model is: its choice is the first in the file, and means nothing."""
    strategy = mixture(0.0, imitation_weight=1.0, indifferent=indifferent)
    for values, imitated in (([1.0, 0.0], True), ([1.0, 1.0], False), ([0.0, 1.0], True)):
        seen = situation(values)._replace(confidence=ModelConfidence.RELIABLE)
        strategy.propose(seen, Known([0.0, 1.0]))
        for following in (seen.forecast, situation([1.0, 1.0]).forecast, None):
            guidance = strategy.guidance(seen.forecast, 0, following)
            assert guidance is not None
            assert guidance.action == (seen.forecast.choice if imitated else -1)


def test_nobody_is_sure_of_what_is_refused() -> None:
    refused = situation([1.0, 0.0, 0.0], admissible=[True, False, True])
    members = [[0.1, 9.0, 0.0], [0.1, 9.0, 0.0]]
    assert (
        mixture(0.0, confidence_margin=1.0).propose(
            refused, Known([0.1, 9.0, 0.0], members=members)
        )
        is None
    )


def test_it_grows_by_its_unit_and_is_restored() -> None:
    strategy = mixture(0.1)
    for unit in ("step", "episode", "game", "game"):
        strategy.end_unit(unit)
    assert strategy.rho == 0.6
    other = mixture(0.0, seed=9)
    other.load_state_dict(json.loads(json.dumps(strategy.state_dict())))
    assert other.rho == 0.6
    assert [learner_acts(strategy) for _ in range(50)] == [learner_acts(other) for _ in range(50)]
    strategy.end_unit("game")
    strategy.end_unit("game")
    assert strategy.rho == 0.9
