"""Imitate, then learn: an end that is drawn, until which the planner is copied."""

from __future__ import annotations

import pytest

from serp.control.strategies.imitate import ImitateThenLearn
from tests.serp.control.scene import Known, guide, learner_acts, situation, told


def imitating(steps: int = 10, seed: int = 0) -> ImitateThenLearn:
    return ImitateThenLearn(guide(imitation_steps=steps), seed)


def end_of(strategy: ImitateThenLearn, most: int) -> int:
    """Return K: after so many env steps imitation is over."""
    for step in range(most + 1):
        if strategy.margin_weight == 0.0:
            return step
        strategy.end_unit("step")
        strategy.end_unit("episode")  # does not count
    raise AssertionError(f"still imitating after {most} steps")


@pytest.mark.parametrize("steps", [1, 2, 3, 40])
def test_k_is_drawn_from_the_second_half(steps: int) -> None:
    ends = [end_of(imitating(steps, seed), steps) for seed in range(400)]
    assert set(ends) == set(range(steps // 2, steps + 1))


def test_the_planners_share_falls_from_one_to_nothing() -> None:
    strategy, shares = imitating(10_000), []
    while strategy.margin_weight:
        shares.append((strategy.rho, learner_acts(strategy)))
        strategy.end_unit("step")
    tenth = len(shares) // 10
    tenths = [shares[k * tenth : (k + 1) * tenth] for k in range(10)]
    acted = [sum(learner for _, learner in part) / tenth for part in tenths]
    rho = [sum(rho for rho, _ in part) / tenth for part in tenths]
    assert acted == pytest.approx(rho, abs=0.08)
    assert acted[0] < 0.15
    assert acted[-1] > 0.85


def test_until_k_the_greedy_choice_is_mixed_in_and_the_planner_imitated_and_never_after() -> None:
    strategy, explorer = imitating(), Known([0.0, 1.0], explored=0)
    seen = situation([1.0, 0.0])
    while strategy.margin_weight:
        proposal = strategy.propose(seen, explorer)
        assert proposal is None or (proposal.action == 1 and not proposal.exploratory)
        for action in (0, 1):  # whoever acted
            assert told(strategy, action, [0.0, 1.0]).action == 1
        strategy.end_unit("step")
    proposal = strategy.propose(seen, explorer)
    assert proposal is not None
    assert proposal.exploratory
    assert told(strategy, 1, [0.0, 1.0]).action == -1
