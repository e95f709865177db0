"""The cart-pole: Gymnasium's dynamics with the paper's limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from hypothesis import given
from hypothesis import strategies as st

from serp_envs import CartPole


def at(env: CartPole, state: tuple[float, float, float, float]) -> CartPole:
    """The environment in this state, its episode running."""
    env.reset(seed=0)
    env.state = np.array(state)
    return env


# Dynamics


@given(
    state=st.tuples(st.floats(-2.3, 2.3), st.floats(-3, 3), st.floats(-0.2, 0.2), st.floats(-3, 3)),
    actions=st.lists(st.integers(0, 1), min_size=1, max_size=40),
)
def test_dynamics_equal_gymnasiums_bit_for_bit(
    state: tuple[float, float, float, float], actions: list[int]
) -> None:
    ours, theirs = at(CartPole(), state), CartPoleEnv()
    theirs.reset(seed=0)
    theirs.state = np.array(state)
    for action in actions:
        observation, reward, ended, truncated, _ = ours.step(action)
        their_observation, their_reward, their_ended, _, _ = theirs.step(action)
        assert observation.tobytes() == their_observation.tobytes()
        assert observation.dtype == np.float32
        assert ours.state is not None
        assert theirs.state is not None
        assert ours.state.tobytes() == theirs.state.tobytes()
        assert not truncated
        if their_ended:  # the wider angle may go on, from here on Gymnasium's is undefined
            break
        assert (reward, ended) == (their_reward, False)


# Limits, reward, end


def test_the_pole_may_lean_15_degrees_and_the_cart_go_2_4_metres() -> None:
    env = CartPole()
    assert math.degrees(env.theta_threshold_radians) == pytest.approx(15)
    assert env.theta_threshold_radians == pytest.approx(0.2618, abs=1e-5)
    assert env.x_threshold == 2.4
    assert env.observation_space.high[[0, 2]] == pytest.approx([4.8, math.radians(30)])


# Explicit Euler moves position and angle by the old velocities alone, and those are 0 here: the
# state is where it was put, on either side of a limit.
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("name", "flag", "limit"),
    [
        ("angle_limit", "fallen", math.radians(15)),
        ("angle_limit", "fallen", 0.1),
        ("angle_limit", "fallen", 0.4),
        ("track_limit", "off_track", 2.4),
        ("track_limit", "off_track", 1.0),
    ],
)
def test_an_episode_ends_just_beyond_a_limit(
    name: str, flag: str, limit: float, sign: float
) -> None:
    env = CartPole(**{name: limit})  # type: ignore[arg-type]

    def step_from(place: float) -> tuple[Any, ...]:
        x, theta = (place, 0.0) if name == "track_limit" else (0.0, place)
        return at(env, (sign * x, 0.0, sign * theta, 0.0)).step(0)

    goes_on = {"fallen": False, "off_track": False}
    assert step_from(limit)[1:] == (1.0, False, False, goes_on)
    beyond = step_from(math.nextafter(limit, 9))
    assert beyond[1:] == (1.0, True, False, {**goes_on, flag: True})
    assert env.observation_space.contains(beyond[0])


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        *(("angle_limit", v) for v in (0.0, -0.2618, 0.05, math.pi / 2, 15.0, math.nan, math.inf)),
        *(("track_limit", v) for v in (0.0, -2.4, 0.05, math.nan, math.inf)),
    ],
)
def test_a_limit_out_of_range_is_refused(name: str, limit: float) -> None:
    with pytest.raises(ValueError, match=name):
        CartPole(**{name: limit})  # type: ignore[arg-type]


# Rendering
