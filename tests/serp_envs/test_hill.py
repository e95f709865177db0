"""The car in the valley: its physics, and that it takes more than one run-up."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp_envs.hill import FORCES, GRAVITY, SOLVED, START, TOP, Hill, Motion, advance, height
from tests.serp_envs.common import returns

ID = "serp/Hill-v0"
positions = st.floats(-1.5, 1.0)
velocities = st.floats(-2.5, 2.5)


def slope(position: float) -> float:
    return (height(position + 1e-6) - height(position - 1e-6)) / 2e-6


def energy(motion: Motion) -> float:
    """In joules: along the road the car is faster than along the ground."""
    along = motion.velocity**2 * (1.0 + slope(motion.position) ** 2)
    return 0.5 * along + GRAVITY * height(motion.position)


@given(position=positions, velocity=velocities, force=st.sampled_from(FORCES))
def test_energy_is_what_the_engine_gives(position: float, velocity: float, force: float) -> None:
    before = Motion(position, velocity)
    after = advance(before, force)
    given = force * (after.position - before.position)
    # Of the up to 20 J about; the curvature jumps at 0.
    assert energy(after) - energy(before) == pytest.approx(given, abs=0.4)


def test_the_road_goes_down_to_the_valley_and_up_to_the_top() -> None:
    assert height(-0.5) == -0.25
    assert height(TOP) == pytest.approx(1.0 / math.sqrt(6.0))
    assert height(-1e-9) == pytest.approx(height(1e-9), abs=1e-8)
    assert slope(0.0) == pytest.approx(1.0, abs=1e-4)
    assert all(height(b) < height(a) for a, b in pairwise(np.linspace(-2.0, -0.5, 50)))
    assert all(height(b) > height(a) for a, b in pairwise(np.linspace(-0.5, 1.0, 50)))


def test_an_episode_starts_at_rest_about_the_valley_and_ends_at_the_top() -> None:
    env = Hill()
    for seed in range(50):
        _, info = env.reset(seed=seed)
        assert START[0] <= env.motion.position <= START[1]
        assert env.motion.velocity == 0.0
        assert info == {"at_top": False}
    env.motion = Motion(TOP - 0.01, 0.05)
    assert not env.step(1)[2]
    env.motion = Motion(TOP - 0.01, 1.0)
    observation, reward, terminated, truncated, info = env.step(1)
    assert observation[0] >= TOP
    assert (reward, terminated, truncated, info) == (-1.0, True, False, {"at_top": True})


def test_no_constant_force_gets_it_up() -> None:
    for action in range(3):
        assert returns(ID, lambda *_, action=action: action, 10) == [-200.0] * 10


def test_it_is_solved_by_run_ups_and_not_by_chance() -> None:
    rng = np.random.default_rng(1)
    assert min(returns(ID, lambda _, velocity: 2 if velocity > 0.0 else 0, 20)) > SOLVED
    assert np.mean(returns(ID, lambda *_: int(rng.integers(3)), 20)) < 3.0 * SOLVED
