from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.learning.dqn import ReturnBounds

REWARDS = st.floats(-10, 10)


@given(
    discount=st.floats(0, 0.99),
    going_on=st.lists(REWARDS, max_size=40),
    last=REWARDS,
)
def test_no_return_of_the_rewards_seen_lies_outside(
    discount: float, going_on: list[float], last: float
) -> None:
    bounds = ReturnBounds(discount)
    for reward in going_on:
        bounds.observe(reward, terminated=False)
    bounds.observe(last, terminated=True)
    for start in range(len(going_on) + 1):
        rewards = [*going_on[start:], last]
        value = sum(discount**k * reward for k, reward in enumerate(rewards))
        assert bounds.lower - 1e-9 <= value <= bounds.upper + 1e-9


@given(discount=st.floats(0, 0.99), low=REWARDS, high=REWARDS, last=REWARDS)
def test_bounds_are_reached(discount: float, low: float, high: float, last: float) -> None:
    bounds = ReturnBounds(discount)
    for reward in (low, high):
        bounds.observe(reward, terminated=False)
    bounds.observe(last, terminated=True)
    for_ever = [reward / (1 - discount) for reward in (low, high)]
    assert bounds.lower == pytest.approx(min(*for_ever, last))
    assert bounds.upper == pytest.approx(max(*for_ever, last))
