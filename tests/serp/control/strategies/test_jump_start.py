"""Jump-start: the planner's part of an episode comes first, and only ever becomes smaller."""

from __future__ import annotations

import math
from random import Random

import pytest

from serp.control.strategies.jump_start import JumpStart
from tests.serp.control.strategies.scene import Known, guide, learner_acts, situation

FIRST = 5
"""In so many episodes the planner acts alone."""


def episode(strategy: JumpStart, return_: float, length: int) -> list[bool]:
    """Play an episode; return for every step whether the learner acted."""
    steps = [learner_acts(strategy) for _ in range(length)]
    strategy.end_episode(return_, length)
    return steps


def test_the_planner_acts_alone_in_the_first_episodes() -> None:
    strategy = JumpStart(guide(jump_stages=4, jump_tolerance=0.1))
    for length in (3, 12, 7, 12, 2):
        assert strategy.planned_steps == math.inf
        assert strategy.rho == 0.0
        assert not any(episode(strategy, 1.0, length))
    assert strategy.planned_steps == 12  # the longest of them


def test_the_planner_acts_in_the_first_h_steps_of_an_episode_and_the_learner_after_them() -> None:
    strategy = JumpStart(guide(jump_stages=5, jump_tolerance=0.0))
    random = Random(1)
    for _ in range(60):
        h, length = strategy.planned_steps, random.randint(1, 10)
        assert episode(strategy, 1.0, length) == [step >= h for step in range(length)]
    assert strategy.planned_steps == 0
    assert strategy.rho == 1.0


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("level", [-3.0, 0.0, 200.0])
def test_h_shrinks_stage_by_stage_to_nothing_while_returns_hold(
    tolerance: float, level: float
) -> None:
    strategy = JumpStart(guide(jump_stages=4, jump_tolerance=tolerance))
    seen = []
    for _ in range(FIRST * 6):
        episode(strategy, level, 20)
        seen.append(strategy.planned_steps)
    stages = [math.inf, 20.0, 15.0, 10.0, 5.0, 0.0, 0.0]
    assert seen == [stages[(k + 1) // FIRST] for k in range(FIRST * 6)]


def test_h_stays_where_returns_fall_and_goes_on_when_they_are_back() -> None:
    strategy = JumpStart(guide(jump_stages=4, jump_tolerance=0.1))
    for _ in range(FIRST):
        episode(strategy, 100.0, 20)
    for _ in range(3 * FIRST):
        episode(strategy, 80.0, 20)
        assert strategy.planned_steps == 20
    for _ in range(FIRST):  # the mean of five is within the tolerance of the best again
        episode(strategy, 95.0, 20)
    assert strategy.planned_steps == 15


def test_the_mark_is_the_best_mean_so_far() -> None:
    for worse, h in ((-5.6, 8), (-5.4, 7)):
        strategy = JumpStart(guide(jump_stages=9, jump_tolerance=0.1))
        for return_ in (-10.0, -5.0, worse):
            for _ in range(FIRST):
                episode(strategy, return_, 9)
        assert strategy.planned_steps == pytest.approx(h)


def test_h_never_grows_whatever_happens() -> None:
    for seed in range(20):
        random = Random(seed)
        stages, tolerance = random.randint(1, 12), random.random()
        strategy = JumpStart(guide(jump_stages=stages, jump_tolerance=tolerance))
        before = strategy.planned_steps
        for _ in range(200):
            episode(strategy, random.gauss(0, 10), random.randint(1, 30))
            assert strategy.planned_steps <= before
            before = strategy.planned_steps
        assert before < math.inf


def test_the_trained_policy_is_the_learners() -> None:
    strategy = JumpStart(guide(jump_stages=2, jump_tolerance=0.1))
    proposal = strategy.propose_greedily(situation([1.0, 0.0]), Known([0.0, 1.0]))
    assert proposal is not None
    assert proposal.action == 1
    assert not learner_acts(strategy)  # and asking for it is no step of training


def test_rho_says_who_acts_next() -> None:
    strategy = JumpStart(guide(jump_stages=2, jump_tolerance=0.1))
    random = Random(3)
    for _ in range(40):
        for _ in range(6):
            assert strategy.rho == learner_acts(strategy)
        strategy.end_episode(random.random(), 6)
