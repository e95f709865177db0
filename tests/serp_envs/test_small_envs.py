"""Hill, landing and swing-up: their physics, their ends, and that they can be solved."""

import math

import numpy as np
import pytest
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from hypothesis import given
from hypothesis import strategies as st

from serp_envs import CartPole, Landing, hill, landing, swing_up
from serp_envs.landing import PAD, REACH, SOFT
from tests.serp_envs.common import returns


@pytest.mark.parametrize(
    ("motion", "reward", "flag"),
    [
        ((0.0, 0.02, 0.0, -0.8), 1.0, "landed"),
        ((PAD - 0.1, 0.02, 0.4, -0.8), 1.0, "landed"),
        ((0.0, 0.02, 0.0, -SOFT - 0.05), -1.0, "crashed"),
        ((0.0, 0.02, 0.6 * SOFT, -0.8), -1.0, "crashed"),
        ((-PAD - 0.1, 0.02, 0.0, -0.8), -1.0, "crashed"),
        ((REACH[0] + 1.0, 0.02, 0.0, -0.8), -1.0, "crashed"),  # on the ground it is found
        ((-REACH[0], 5.0, -1.0, 0.0), -1.0, "lost"),
        ((0.0, REACH[1], 0.0, 1.0), -1.0, "lost"),
        ((PAD + 1.0, 10.0, 2.0, -4.0), 0.0, ""),
    ],
)
def test_how_a_landing_ends(motion, reward, flag):
    env = Landing()
    env.reset(seed=0)
    env.motion = landing.Motion(*motion)
    flags = {name: name == flag for name in ("landed", "crashed", "lost")}
    assert env.step(0)[1:] == (reward, reward != 0.0, False, flags)


def run_up(_, velocity):
    return 2 if velocity > 0.0 else 0


def swing(height, side, speed):
    """Push along until the energy is right, hold at the top."""
    if height > 0.8:
        wanted = -(20.0 * side + 5.0 * speed)
        return 2 if wanted > 2.5 else 0 if wanted < -2.5 else 1
    if height + speed * speed / (2.0 * swing_up.GRAVITY) < 1.0:
        return 2 if speed > 0.0 else 0
    return 1


def land(offset, height, sideways, upwards):
    """Brake where it falls too fast for its height, else steer for the pad."""
    if upwards < -(0.4 + 0.2 * height):
        return 3
    wanted = max(-1.0, min(1.0, -0.4 * offset))
    return 2 if sideways < wanted - 0.1 else 1 if sideways > wanted + 0.1 else 0


@pytest.mark.parametrize(
    ("name", "rule", "of_many", "solved", "by_chance", "by_one", "actions"),
    [
        ("serp/Hill-v0", run_up, min, hill.SOLVED, -150.0, -199.0, 3),
        ("serp/SwingUp-v0", swing, min, swing_up.SOLVED, 0.5 * swing_up.SOLVED,
         0.25 * swing_up.SOLVED, 3),
        ("serp/Landing-v0", land, np.mean, landing.SOLVED, 0.0, 0.0, 4),
    ],
)  # fmt: skip
def test_it_is_solved_by_a_rule_and_neither_by_chance_nor_by_one_action(
    name, rule, of_many, solved, by_chance, by_one, actions
):
    rng = np.random.default_rng(1)
    assert of_many(returns(name, rule, 20)) >= solved
    assert np.mean(returns(name, lambda *_: int(rng.integers(actions)), 20)) < by_chance
    for action in range(actions):
        assert max(returns(name, lambda *_, action=action: action, 5)) < by_one


LEAN, TRACK = math.radians(15), 2.4


def at(env, *state):
    """The environment in this state, its episode running."""
    env.reset(seed=0)
    env.state = np.array(state)
    return env


@given(
    state=st.tuples(st.floats(-2.3, 2.3), st.floats(-3, 3), st.floats(-0.2, 0.2), st.floats(-3, 3)),
    actions=st.lists(st.integers(0, 1), min_size=1, max_size=40),
)
def test_dynamics_equal_gymnasiums_bit_for_bit(state, actions):
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
def test_an_episode_ends_just_beyond_a_limit(options, flag, limit, sign):
    env = CartPole(**options)

    def step_from(place):
        x, theta = (place, 0.0) if flag == "off_track" else (0.0, place)
        return at(env, sign * x, 0.0, sign * theta, 0.0).step(0)

    goes_on = {"fallen": False, "off_track": False}
    assert step_from(limit)[1:] == (1.0, False, False, goes_on)
    beyond = step_from(math.nextafter(limit, 9))
    assert beyond[1:] == (1.0, True, False, {**goes_on, flag: True})
    assert env.observation_space.contains(beyond[0])
