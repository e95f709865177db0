"""The lead goes to planner or learner as their returns suggest."""

from __future__ import annotations

import numpy as np
import pytest

from serp.control.strategies.evidence import Evidence
from serp.settings import Settings
from tests.serp.control.scene import learner_acts, told


def played(planner: float, learner: float, noise: float, seed: int, episodes: int) -> Evidence:
    """A strategy after episodes whose mean return depends on who leads."""
    strategy, rng = Evidence(Settings(), seed), np.random.default_rng(seed)
    for _ in range(episodes):
        mean = learner if learner_acts(strategy) else planner
        strategy.end_episode(mean + noise * rng.normal(), 10)
    return strategy


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_better_one_leads_in_the_end_and_is_the_trained_policy(seed: int, scale: float) -> None:
    worse = played(10.0 * scale, 0.0, scale, seed, 60)
    better = played(0.0, 10.0 * scale, scale, seed, 60)
    assert worse.rho < 0.1 and worse.choice == "the planner's choice"
    assert better.rho > 0.9 and better.choice == "the learner's choice"


def test_the_planner_leads_first_and_the_learner_is_tried_seldom_where_it_is_worse() -> None:
    led = 0
    for seed in range(20):
        strategy, rng = Evidence(Settings(), seed), np.random.default_rng(seed)
        assert not learner_acts(strategy)
        for _ in range(100):
            leads = learner_acts(strategy)
            led += leads
            strategy.end_episode((0.0 if leads else 10.0) + rng.normal(), 10)
    assert 0 < led < 0.15 * 20 * 100


@pytest.mark.parametrize("value", [0.0, -200.0, 0.1, 1e12])
def test_equal_returns_leave_the_lead_with_the_planner(value: float) -> None:
    assert played(value, value, 0.0, 1, 50).rho == 0.0


def test_a_learner_that_becomes_better_takes_over() -> None:
    late = 0
    for seed in range(20):
        strategy, rng = Evidence(Settings(), seed), np.random.default_rng(seed)
        for episode in range(200):
            learner = 0.0 if episode < 60 else 20.0
            mean = learner if learner_acts(strategy) else 10.0
            strategy.end_episode(mean + rng.normal(), 10)
        late += strategy.rho > 0.9
    assert late >= 18


@pytest.mark.parametrize("seed", range(3))
def test_the_learner_imitates_the_planner_as_long_as_that_is_better(seed: int) -> None:
    settings = Settings().replace({"arbiter": {"imitation_weight": 0.5}})
    strategy, rng = Evidence(settings, seed), np.random.default_rng(seed)
    assert strategy.margin_weight == 0.5  # nothing is known of the learner
    for episode in range(200):
        learner = 0.0 if episode < 60 else 20.0
        strategy.end_episode((learner if learner_acts(strategy) else 10.0) + rng.normal(), 10)
        assert strategy.margin_weight == 0.5 * max(0.0, 1.0 - 2.0 * strategy.rho)
    assert strategy.margin_weight == 0.0


def test_a_planner_without_a_reason_is_not_imitated() -> None:
    """Its choice is the first in the file, and means nothing."""
    strategy = Evidence(Settings().replace({"arbiter": {"imitation_weight": 1.0}}))
    for values, imitated in (([1.0, 0.0], 0), ([1.0, 1.0], -1), ([0.0, 1.0], 1)):
        assert told(strategy, 0, values).action == imitated
        assert told(strategy, 0, values, [1.0, 1.0]).action == imitated
