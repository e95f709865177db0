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

LEAN, TRACK = math.radians(15), 2.4


def at(env: Any, *state: float) -> Any:
    """The environment in this state, its episode running."""
    env.reset(seed=0)
    env.state = np.array(state)
    return env


@given(
    state=st.tuples(st.floats(-2.3, 2.3), st.floats(-3, 3), st.floats(-0.2, 0.2), st.floats(-3, 3)),
    actions=st.lists(st.integers(0, 1), min_size=1, max_size=40),
)
def test_dynamics_equal_gymnasiums_bit_for_bit(
    state: tuple[float, float, float, float], actions: list[int]
) -> None:
    ours, theirs = at(CartPole(), *state), at(CartPoleEnv(), *state)
    for action in actions:
        observation, reward, ended, truncated, _ = ours.step(action)
        their_observation, their_reward, their_ended, _, _ = theirs.step(action)
        assert observation.dtype == np.float32
        assert observation.tobytes() == their_observation.tobytes()
        assert ours.state.tobytes() == theirs.state.tobytes()
        if their_ended:  # the wider angle may go on, from here on Gymnasium's is undefined
            break
        assert (reward, ended, truncated) == (their_reward, False, False)


# Explicit Euler moves position and angle by the old velocities alone, and those are 0 here: the
# state is where it was put, on either side of a limit.
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("options", "flag", "limit"),
    [
        ({}, "fallen", LEAN),
        ({"angle_limit": 0.4}, "fallen", 0.4),
        ({}, "off_track", TRACK),
        ({"track_limit": 1.0}, "off_track", 1.0),
    ],
)
def test_an_episode_ends_just_beyond_a_limit(
    options: dict[str, float], flag: str, limit: float, sign: float
) -> None:
    env = CartPole(**options)  # type: ignore[arg-type]

    def step_from(place: float) -> tuple[Any, ...]:
        x, theta = (place, 0.0) if flag == "off_track" else (0.0, place)
        return at(env, sign * x, 0.0, sign * theta, 0.0).step(0)  # type: ignore[no-any-return]

    goes_on = {"fallen": False, "off_track": False}
    assert step_from(limit)[1:] == (1.0, False, False, goes_on)
    beyond = step_from(math.nextafter(limit, 9))
    assert beyond[1:] == (1.0, True, False, {**goes_on, flag: True})
    assert env.observation_space.contains(beyond[0])
