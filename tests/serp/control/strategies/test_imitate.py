"""Imitate, then learn: an end that is drawn, until which the planner is copied."""

from __future__ import annotations

import pytest

from serp.control.strategies.imitate import ImitateThenLearn
from tests.serp.control.strategies.scene import Known, forecast, guide, learner_acts, situation


def imitating(steps: int = 1_000, seed: int = 0) -> ImitateThenLearn:
    return ImitateThenLearn(guide(imitation_steps=steps), seed)


def end_of(strategy: ImitateThenLearn, most: int) -> int:
    """Return K: after so many env steps imitation is over."""
    for step in range(most + 1):
        if strategy.margin_weight == 0.0:
            return step
        strategy.end_unit("step")
    raise AssertionError(f"still imitating after {most} steps")


def test_k_is_drawn_from_the_second_half() -> None:
    steps = 40
    ends = [end_of(imitating(steps, seed), steps) for seed in range(400)]
    assert set(ends) == set(range(steps // 2, steps + 1))


def test_only_steps_count() -> None:
    strategy = imitating(10)
    for unit in ("episode", "game"):
        for _ in range(100):
            strategy.end_unit(unit)
    assert strategy.margin_weight == 1.0
    assert strategy.rho == 0.0


def test_the_planners_share_falls_from_one_to_nothing() -> None:
    strategy = imitating(10_000)
    tenths: list[float] = []
    shares = []
    while strategy.margin_weight:
        acted = [learner_acts(strategy)]
        shares.append((strategy.rho, acted[0]))
        strategy.end_unit("step")
    tenth = len(shares) // 10
    for k in range(10):
        part = shares[k * tenth : (k + 1) * tenth]
        tenths.append(sum(acted for _, acted in part) / tenth)
        mean = sum(rho for rho, _ in part) / tenth
        assert abs(tenths[-1] - mean) < 0.08
    assert tenths[0] < 0.15
    assert tenths[-1] > 0.85
    assert all(learner_acts(strategy) for _ in range(50))
    assert strategy.rho == 1.0


def test_it_is_the_greedy_choice_that_is_mixed_in_and_exploration_comes_after() -> None:
    strategy = imitating(10)
    explorer = Known([0.0, 1.0], explored=0)
    seen = situation([1.0, 0.0])
    while strategy.margin_weight:
        proposal = strategy.propose(seen, explorer)
        assert proposal is None or (proposal.action == 1 and not proposal.exploratory)
        strategy.end_unit("step")
    proposal = strategy.propose(seen, explorer)
    assert proposal is not None
    assert proposal.exploratory


def test_the_planners_word_is_imitated_in_every_state_until_k_and_never_after() -> None:
    strategy = imitating(10)
    while strategy.margin_weight:
        for action in (0, 1):  # whoever acted
            said = strategy.guidance(forecast([0.0, 1.0]), action, None)
            assert said is not None
            assert said.action == 1
        strategy.end_unit("step")
    said = strategy.guidance(forecast([0.0, 1.0]), 1, None)
    assert said is not None
    assert said.action == -1


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_the_smallest_numbers_of_steps_work(steps: int) -> None:
    for seed in range(10):
        strategy = imitating(steps, seed)
        for _ in range(4):
            assert 0.0 <= strategy.rho <= 1.0
            learner_acts(strategy)
            strategy.end_unit("step")
        assert strategy.rho == 1.0
