"""The cart-pole: Gymnasium's dynamics, the paper's limits, exact repetition and snapshots."""

from __future__ import annotations

import json
import math
import os
import random
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from gymnasium.utils.env_checker import check_env
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp_envs import CartPole, register

ENV_ID = "serp_envs:serp/CartPole-v0"


def episode(env: gymnasium.Env[Any, Any], seed: int | None, actions: NDArray[Any]) -> list[Any]:
    """All that an episode shows, floats as their bits, until it ends or the actions do."""
    observation, info = env.reset(seed=seed)
    seen: list[Any] = [(observation.tobytes(), info)]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(int(action))
        seen.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated or truncated:
            break
    return seen


def balance(observation: NDArray[np.float32]) -> int:
    """A controller that balances for thousands of steps."""
    x, x_dot, theta, theta_dot = observation
    return int(0.1 * x + 0.3 * x_dot + 3 * theta + theta_dot > 0)


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


@pytest.mark.parametrize("seed", range(5))
def test_whole_episodes_equal_cartpole_v1_where_the_limits_are_equal(seed: int) -> None:
    ours = gymnasium.make(ENV_ID, angle_limit=12 * 2 * math.pi / 360)
    theirs = gymnasium.make("CartPole-v1")
    actions = np.random.default_rng(seed).integers(0, 2, 500)
    # everything but the info
    assert [step[:-1] for step in episode(ours, seed, actions)] == [
        step[:-1] for step in episode(theirs, seed, actions)
    ]


@pytest.mark.parametrize("seed", range(5))
def test_starts_equal_gymnasiums_and_lie_within_the_bound(seed: int) -> None:
    observation, info = CartPole().reset(seed=seed)
    assert observation.tobytes() == CartPoleEnv().reset(seed=seed)[0].tobytes()
    assert np.all(np.abs(observation) <= 0.05)
    assert info == {"fallen": False, "off_track": False}


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
@pytest.mark.parametrize("limit", [math.radians(15), 0.1, 0.4])
def test_an_episode_ends_just_beyond_the_angle_limit(limit: float, sign: float) -> None:
    env = CartPole(angle_limit=limit)
    inside = at(env, (0.0, 0.0, sign * limit, 0.0)).step(0)
    assert inside[1:] == (1.0, False, False, {"fallen": False, "off_track": False})
    beyond = at(env, (0.0, 0.0, sign * math.nextafter(limit, 2), 0.0)).step(0)
    assert beyond[1:] == (1.0, True, False, {"fallen": True, "off_track": False})
    assert env.observation_space.contains(beyond[0])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("limit", [2.4, 1.0])
def test_an_episode_ends_just_beyond_the_track_limit(limit: float, sign: float) -> None:
    env = CartPole(track_limit=limit)
    inside = at(env, (sign * limit, 0.0, 0.0, 0.0)).step(1)
    assert inside[1:] == (1.0, False, False, {"fallen": False, "off_track": False})
    beyond = at(env, (sign * math.nextafter(limit, 9), 0.0, 0.0, 0.0)).step(1)
    assert beyond[1:] == (1.0, True, False, {"fallen": False, "off_track": True})
    assert env.observation_space.contains(beyond[0])


@pytest.mark.parametrize("limit", [0.0, -0.2618, 0.05, math.pi / 2, 15.0, math.nan, math.inf])
def test_an_angle_limit_out_of_range_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match="angle_limit"):
        CartPole(angle_limit=limit)


@pytest.mark.parametrize("limit", [0.0, -2.4, 0.05, math.nan, math.inf])
def test_a_track_limit_out_of_range_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match="track_limit"):
        CartPole(track_limit=limit)


@pytest.mark.parametrize("seed", range(10))
def test_the_return_is_the_length_of_the_episode(seed: int) -> None:
    env = gymnasium.make(ENV_ID)
    seen = episode(env, seed, np.zeros(500, dtype=int))
    rewards = [step[1] for step in seen[1:]]
    assert rewards == [1.0] * len(rewards)
    assert seen[-1][2:] == (True, False, {"fallen": True, "off_track": False})
    assert all(step[2:] == (False, False, seen[0][1]) for step in seen[1:-1])


def test_a_step_after_the_end_is_worth_nothing_and_warned_of() -> None:
    env = at(CartPole(), (0.0, 0.0, 0.5, 0.0))
    assert env.step(0)[1] == 1.0
    with pytest.warns(UserWarning, match="already returned terminated"):
        assert env.step(0)[1] == 0.0


def test_the_time_limit_truncates_after_500_steps() -> None:
    env = gymnasium.make(ENV_ID)
    observation, _ = env.reset(seed=0)
    for number in range(1, 501):
        observation, reward, terminated, truncated, _ = env.step(balance(observation))
        assert (reward, terminated, truncated) == (1.0, False, number == 500)


def test_the_class_itself_knows_no_time_limit() -> None:
    env = CartPole()
    observation, _ = env.reset(seed=0)
    for _ in range(2000):
        observation, _, terminated, truncated, _ = env.step(balance(observation))
        assert not terminated
        assert not truncated


@pytest.mark.parametrize("action", [2, -1, 0.5, None])
def test_an_unknown_action_is_refused(action: Any) -> None:
    env = CartPole()
    env.reset(seed=0)
    with pytest.raises(AssertionError, match="invalid"):
        env.step(action)


# Gymnasium's rules


# Velocities have no bound, in Gymnasium's cart-pole neither; its checker finds that unusual.
@pytest.mark.usefixtures("no_screen")
@pytest.mark.filterwarnings(
    "error",
    "ignore:.*Box observation space minimum value is -infinity",
    "ignore:.*Box observation space maximum value is infinity",
)
def test_gymnasiums_checker_has_nothing_else_to_say() -> None:
    check_env(gymnasium.make(ENV_ID).unwrapped)


def test_registering_again_changes_nothing() -> None:
    before = gymnasium.registry["serp/CartPole-v0"]
    register()
    assert gymnasium.registry["serp/CartPole-v0"] is before
    assert before.max_episode_steps == 500


def test_registering_brings_back_what_was_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(gymnasium.registry, "serp/CartPole-v0")
    register()
    assert isinstance(gymnasium.make("serp/CartPole-v0").unwrapped, CartPole)


def test_it_can_be_made_many_at_once() -> None:
    envs = gymnasium.make_vec(ENV_ID, num_envs=3, vectorization_mode="sync", angle_limit=0.2)
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (3, 4)
    assert envs.get_attr("theta_threshold_radians") == (0.2, 0.2, 0.2)
    envs.close()


# Repetition


@given(seed=st.integers(0, 2**32 - 1))
def test_equal_seeds_give_equal_episodes_also_on_a_used_object(seed: int) -> None:
    actions = np.random.default_rng(seed).integers(0, 2, 60)
    used = CartPole()
    first = episode(used, seed, actions)
    assert episode(used, seed, actions) == first
    assert episode(CartPole(), seed, actions) == first


def test_episodes_go_on_from_one_seed_without_repeating() -> None:
    def run() -> list[Any]:
        env = CartPole()
        return [episode(env, 7 if number == 0 else None, np.ones(20)) for number in range(5)]

    first = run()
    assert run() == first
    assert len({show[0][0] for show in first}) == 5


def test_global_generators_are_neither_read_nor_moved() -> None:
    random.seed(3)
    np.random.seed(3)
    before = random.getstate(), repr(np.random.get_state())
    first = episode(CartPole(), 5, np.ones(30))
    CartPole().reset()
    assert (random.getstate(), repr(np.random.get_state())) == before
    random.seed(4)
    np.random.seed(4)
    assert episode(CartPole(), 5, np.ones(30)) == first


# Snapshots


def show_rest(env: CartPole, actions: NDArray[Any]) -> list[Any]:
    """The rest of an episode and the two after it, as they show themselves."""
    seen: list[Any] = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(int(action))
        seen.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated:
            break
    return [seen, *(episode(env, None, actions) for _ in range(2))]


@given(seed=st.integers(0, 2**32 - 1), cut=st.integers(0, 8), into_used=st.booleans())
@example(seed=0, cut=0, into_used=False)
def test_a_snapshot_through_json_continues_exactly(seed: int, cut: int, into_used: bool) -> None:
    generator = np.random.default_rng(seed)
    before, after = generator.integers(0, 2, cut), generator.integers(0, 2, 50)
    env = CartPole(angle_limit=0.4)
    episode(env, seed, before)
    text = json.dumps(env.state_dict(), allow_nan=False)
    uninterrupted = show_rest(env, after)

    other = CartPole(angle_limit=0.4)
    if into_used:
        episode(other, seed + 1, after)
    other.load_state_dict(json.loads(text))
    assert json.dumps(other.state_dict()) == text
    assert show_rest(other, after) == uninterrupted


def test_taking_a_snapshot_changes_nothing() -> None:
    env, undisturbed = CartPole(), CartPole()
    env.reset(seed=1)
    undisturbed.reset(seed=1)
    snapshot = env.state_dict()
    kept = json.dumps(snapshot)
    assert show_rest(env, np.ones(30)) == show_rest(undisturbed, np.ones(30))
    assert json.dumps(snapshot) == kept  # and is no view of the environment


def test_a_snapshot_before_the_first_reset_and_one_after_the_end_continue_too() -> None:
    fresh, other = CartPole(), CartPole()
    other.load_state_dict(fresh.state_dict())
    assert other.state is None
    assert fresh.reset()[0].tobytes() == other.reset()[0].tobytes()

    at(fresh, (0.0, 0.0, 0.5, 0.0)).step(0)
    other.load_state_dict(fresh.state_dict())
    with pytest.warns(UserWarning, match="already returned terminated"):
        assert other.step(0)[1] == 0.0


def broken(**change: Any) -> dict[str, Any]:
    """A snapshot with this change."""
    env = CartPole()
    env.reset(seed=1)
    return {**env.state_dict(), **change}


@pytest.mark.parametrize(
    ("snapshot", "says"),
    [
        ({}, "snapshot of CartPole"),
        (broken(more=1), "snapshot of CartPole"),
        (broken(angle_limit=0.3), "angle_limit"),
        (broken(track_limit=1.0), "track_limit"),
        (broken(state=[1.0, 2.0]), "four finite numbers"),
        (broken(state=[0.0, 0.0, math.nan, 0.0]), "four finite numbers"),
        (broken(state="upright"), "four numbers"),
        (broken(steps_beyond_terminated=-1), "steps_beyond_terminated"),
        (broken(np_random=None), "np_random"),
        (broken(np_random={"bit_generator": "MT19937"}), "np_random"),
        (broken(np_random={"bit_generator": "PCG64", "state": {"state": 1}}), "np_random"),
        (
            broken(np_random={"bit_generator": "PCG64", "state": {"state": 1, "inc": 3}}),
            "np_random",
        ),
    ],
)
def test_a_broken_snapshot_is_refused_and_nothing_changes(
    snapshot: dict[str, Any], says: str
) -> None:
    env = CartPole()
    env.reset(seed=2)
    env.step(1)
    before = env.state_dict()
    with pytest.raises(ValueError, match=says):
        env.load_state_dict(snapshot)
    assert env.state_dict() == before


# Rendering


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Pygame draws without a display."""
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    yield


@pytest.mark.usefixtures("no_screen")
def test_the_picture_shows_the_pole_leaning() -> None:
    env = CartPole(render_mode="rgb_array")

    def pole_columns(theta: float) -> NDArray[np.intp]:
        picture = at(env, (0.0, 0.0, theta, 0.0)).render()
        assert isinstance(picture, np.ndarray)
        assert (picture.shape, picture.dtype) == ((400, 600, 3), np.uint8)
        return np.nonzero(np.all(picture == (202, 152, 101), axis=2))[1]

    left, upright, right = (pole_columns(theta).mean() for theta in (-0.25, 0.0, 0.25))
    assert left < upright < right
    assert upright == pytest.approx(300, abs=2)
    env.close()


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("mode", ["human", "rgb_array"])
def test_rendering_changes_no_episode(mode: str) -> None:
    env = gymnasium.make(ENV_ID, render_mode=mode)
    env.unwrapped.metadata = {**env.unwrapped.metadata, "render_fps": 0}  # no waiting
    assert episode(env, 3, np.ones(15)) == episode(CartPole(), 3, np.ones(15))
    env.close()
