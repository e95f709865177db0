"""The lander: its physics, what counts as a landing, and that it can be done."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp_envs.landing import (
    CONTROL_PERIOD,
    DRAG,
    GRAVITY,
    PAD,
    REACH,
    SOFT,
    SOLVED,
    START,
    THRUSTS,
    Landing,
    Motion,
    advance,
)
from tests.serp_envs.common import returns

motions = st.builds(
    Motion,
    st.floats(-10.0, 10.0),
    st.floats(0.0, 20.0),
    st.floats(-5.0, 5.0),
    st.floats(-6.0, 6.0),
)
LANDED = {"landed": True, "crashed": False, "lost": False}
CRASHED = {"landed": False, "crashed": True, "lost": False}
LOST = {"landed": False, "crashed": False, "lost": True}
FLYING = {"landed": False, "crashed": False, "lost": False}


def after(motion: Motion) -> tuple[float, bool, dict[str, bool]]:
    """Reward, end and flags where a step without engines has led to about this motion."""
    env = Landing()
    env.reset(seed=0)
    env.motion = motion
    _, reward, terminated, truncated, info = env.step(0)
    assert not truncated
    return reward, terminated, info


def land(offset: float, height: float, sideways: float, upwards: float) -> int:
    """Brake where it falls too fast for its height, else steer for the pad."""
    if upwards < -(0.4 + 0.2 * height):
        return 3
    wanted = max(-1.0, min(1.0, -0.4 * offset))
    return 2 if sideways < wanted - 0.1 else 1 if sideways > wanted + 0.1 else 0


@given(motion=motions, action=st.integers(0, 3))
def test_a_step_is_that_of_much_finer_integration(motion: Motion, action: int) -> None:
    x, y, u, v = motion
    parts = 500
    step = CONTROL_PERIOD / parts
    for _ in range(parts):
        speed = math.hypot(u, v)
        u += step * (THRUSTS[action][0] - DRAG * speed * u)
        v += step * (THRUSTS[action][1] - GRAVITY - DRAG * speed * v)
        x += step * u
        y += step * v
    assert advance(motion, THRUSTS[action]) == pytest.approx((x, y, u, v), abs=0.03)


@pytest.mark.parametrize(
    ("motion", "reward", "info"),
    [
        (Motion(0.0, 0.02, 0.0, -0.8), 1.0, LANDED),
        (Motion(PAD - 0.1, 0.02, 0.4, -0.8), 1.0, LANDED),
        (Motion(0.0, 0.02, 0.0, -SOFT - 0.05), -1.0, CRASHED),
        (Motion(0.0, 0.02, 0.6 * SOFT, -0.8), -1.0, CRASHED),
        (Motion(0.0, 0.02, -0.6 * SOFT, -0.8), -1.0, CRASHED),
        (Motion(PAD + 0.1, 0.02, 0.0, -0.8), -1.0, CRASHED),
        (Motion(-PAD - 0.1, 0.02, 0.0, -0.8), -1.0, CRASHED),
        (Motion(REACH[0], 5.0, 1.0, 0.0), -1.0, LOST),
        (Motion(-REACH[0], 5.0, -1.0, 0.0), -1.0, LOST),
        (Motion(0.0, REACH[1], 0.0, 1.0), -1.0, LOST),
        (Motion(REACH[0] + 1.0, 0.02, 0.0, -0.8), -1.0, CRASHED),  # on the ground it is found
        (Motion(0.0, 0.5, 0.0, -0.8), 0.0, FLYING),
        (Motion(PAD + 1.0, 10.0, 2.0, -4.0), 0.0, FLYING),
    ],
)
def test_how_an_episode_ends(motion: Motion, reward: float, info: dict[str, bool]) -> None:
    assert after(motion) == (reward, reward != 0.0, info)


def test_starts_lie_within_the_bounds() -> None:
    env = Landing()
    for seed in range(50):
        observation, info = env.reset(seed=seed)
        assert info == FLYING
        for value, (low, high) in zip(observation.tolist(), START, strict=True):
            assert low <= value <= high


def test_it_is_solved_by_braking_in_time_and_not_by_chance() -> None:
    rng = np.random.default_rng(1)
    # A landing is worth 1, a crash or getting lost −1.
    landed = returns("serp/Landing-v0", land, 40)
    assert np.mean(landed) >= SOLVED and landed.count(1.0) >= 38
    drawn = returns("serp/Landing-v0", lambda *_: int(rng.integers(4)), 40)
    assert np.mean(drawn) < 0.0 and drawn.count(-1.0) > 30
