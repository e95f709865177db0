"""Jump-start: the planner's part of an episode comes first, and only ever becomes smaller."""

from __future__ import annotations

import math
from random import Random

import pytest

from serp.control.strategies.jump_start import JumpStart
from tests.serp.control.scene import guide, learner_acts

FIRST = 5
"""In so many episodes the planner acts alone."""


def jump_start(stages: int, tolerance: float) -> JumpStart:
    return JumpStart(guide(jump_stages=stages, jump_tolerance=tolerance))


def episode(strategy: JumpStart, return_: float, length: int) -> None:
    """Play an episode: the planner in its first h steps, then the learner."""
    h = strategy.planned_steps
    assert [learner_acts(strategy) for _ in range(length)] == [k >= h for k in range(length)]
    strategy.end_episode(return_, length)


def test_the_planner_acts_alone_in_the_first_episodes() -> None:
    strategy = jump_start(4, 0.1)
    for length in (3, 12, 7, 12, 2):
        assert strategy.planned_steps == math.inf
        episode(strategy, 1.0, length)
    assert strategy.planned_steps == 12  # the longest of them


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("level", [-3.0, 0.0, 200.0])
def test_h_shrinks_stage_by_stage_to_nothing_while_returns_hold(
    tolerance: float, level: float
) -> None:
    strategy, seen = jump_start(4, tolerance), []
    for _ in range(FIRST * 6):
        episode(strategy, level, 20)
        seen.append(strategy.planned_steps)
    stages = [math.inf, 20.0, 15.0, 10.0, 5.0, 0.0, 0.0]
    assert seen == [stages[(k + 1) // FIRST] for k in range(FIRST * 6)]


def test_h_stays_where_returns_fall_and_goes_on_when_they_are_back() -> None:
    strategy = jump_start(4, 0.1)
    for return_, h in ((100.0, 20), (80.0, 20), (80.0, 20), (95.0, 15)):  # 10 % are tolerated
        for _ in range(FIRST):
            episode(strategy, return_, 20)
        assert strategy.planned_steps == h


def test_the_mark_is_the_best_mean_so_far() -> None:
    for worse, h in ((-5.6, 8), (-5.4, 7)):
        strategy = jump_start(9, 0.1)
        for return_ in (-10.0, -5.0, worse):
            for _ in range(FIRST):
                episode(strategy, return_, 9)
        assert strategy.planned_steps == pytest.approx(h)


def test_h_never_grows_whatever_happens() -> None:
    for seed in range(20):
        random = Random(seed)
        strategy = jump_start(random.randint(1, 12), random.random())
        before = math.inf
        for _ in range(60):
            episode(strategy, random.gauss(0, 10), random.randint(1, 30))
            assert strategy.planned_steps <= before
            before = strategy.planned_steps
        assert before < math.inf
