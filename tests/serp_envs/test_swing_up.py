"""The pendulum: its physics, and that it can be swung up but not lifted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp_envs.swing_up import (
    CONTROL_PERIOD,
    FRICTION,
    GRAVITY,
    SOLVED,
    START_BOUND,
    TOP_SPEED,
    TORQUES,
    Motion,
    SwingUp,
    advance,
)
from tests.serp_envs.common import returns

ID = "serp/SwingUp-v0"
angles = st.floats(-4.0, 4.0)
speeds = st.floats(-10.0, 10.0)


def swing_up(height: float, side: float, speed: float) -> int:
    """Push along until the energy is right, hold at the top."""
    if height > 0.8:
        wanted = -(20.0 * side + 5.0 * speed)
        return 2 if wanted > 2.5 else 0 if wanted < -2.5 else 1
    if height + speed * speed / (2.0 * GRAVITY) < 1.0:
        return 2 if speed > 0.0 else 0
    return 1


@given(angle=angles, speed=speeds, torque=st.sampled_from(TORQUES))
def test_a_step_is_that_of_much_finer_integration(
    angle: float, speed: float, torque: float
) -> None:
    fine = np.array([angle, speed])
    parts = 2000
    for _ in range(parts):
        pull = GRAVITY * math.sin(fine[0]) + torque - FRICTION * fine[1]
        fine[1] = min(max(fine[1] + CONTROL_PERIOD / parts * pull, -TOP_SPEED), TOP_SPEED)
        fine[0] += CONTROL_PERIOD / parts * fine[1]
    assert advance(Motion(angle, speed), torque) == pytest.approx(tuple(fine), abs=0.05)


def test_the_observation_is_the_angle_and_the_reward_the_height() -> None:
    env = SwingUp()
    env.reset(seed=0)
    for angle, height in ((0.0, 1.0), (math.pi / 2, 0.5), (math.pi, 0.0)):
        env.motion = Motion(angle, 0.0)
        observation, reward, _, _, info = env.step(1)
        assert reward == pytest.approx(height, abs=0.01)
        assert info["upright"] == (height == 1.0)
        seen = (math.cos(env.motion.angle), math.sin(env.motion.angle), env.motion.speed)
        assert observation == pytest.approx(seen, abs=1e-6)
        assert reward == pytest.approx(0.5 * (1.0 + seen[0]))


def test_an_episode_starts_hanging() -> None:
    env = SwingUp()
    for seed in range(50):
        env.reset(seed=seed)
        assert abs(env.motion.angle - math.pi) <= START_BOUND
        assert abs(env.motion.speed) <= START_BOUND


def test_no_constant_torque_lifts_it() -> None:
    for action in range(3):
        assert max(returns(ID, lambda *_, action=action: action, 5)) < 0.25 * SOLVED


def test_it_is_solved_by_swinging_and_not_by_chance() -> None:
    rng = np.random.default_rng(1)
    assert min(returns(ID, swing_up, 20)) > SOLVED
    assert max(returns(ID, lambda *_: int(rng.integers(3)), 20)) < 0.5 * SOLVED
