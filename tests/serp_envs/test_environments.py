"""Properties of all environments: Gymnasium's rules, exact repetition, pictures."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.serp_envs.common import KINDS, SMALL, actions_of, bits, play

each = pytest.mark.parametrize("kind", KINDS)
SOCCER = [kind for kind in KINDS if "soccer" in kind or "corner" in kind]
seeds = st.integers(0, 2**32 - 1)


def made(kind, **options):
    """An environment that draws without waiting for the clock."""
    env = KINDS[kind][1](**options)
    env.metadata = {**env.metadata, "render_fps": 0}
    return env


# Velocities of the cart-pole have no bound, as in Gymnasium's own; its checker warns of that.
unbounded = pytest.mark.filterwarnings(
    "error",
    "ignore:.*Box observation space minimum value is -infinity",
    "ignore:.*Box observation space maximum value is infinity",
)


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=unbounded) if k == "cartpole" else k for k in KINDS]
)
def test_gymnasiums_checker_has_nothing_to_say(kind):
    options = SMALL if "small" in kind else {}
    check_env(gymnasium.make(f"serp_envs:{KINDS[kind][0]}", **options).unwrapped)


@each
@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_equal_seeds_give_equal_episodes_also_on_a_used_object(kind, seed):
    actions = actions_of(kind, seed, 50)
    options = {"game": 0} if kind in SOCCER else {}
    used = made(kind)
    first = play(used, seed, actions, **options)
    play(used, seed + 1, actions)
    assert play(used, seed, actions, **options) == first
    assert play(made(kind), seed, actions) == first


@each
def test_episodes_of_one_seed_differ(kind):
    env = made(kind)
    starts = {bits(env.reset(seed=7 if k == 0 else None))[0] for k in range(5)}
    assert len(starts) == 5


@each
@settings(max_examples=10, deadline=None)
@given(seed=seeds, sticky=st.integers(1, 40))
def test_every_observation_is_in_the_space(kind, seed, sticky):
    """Also where one action is held for long."""
    env = made(kind)
    observation, _ = env.reset(seed=seed)
    for action in np.repeat(actions_of(kind, seed, 120 // sticky + 1), sticky):
        assert observation.dtype == np.float32
        assert env.observation_space.contains(observation)
        observation, _, terminated, truncated, _ = env.step(action)
        assert env.observation_space.contains(observation)
        assert not (terminated and truncated)
        if terminated or truncated:
            observation, _ = env.reset()


@each
@pytest.mark.parametrize("action", [6, -1, 0.5, None, "left"])
def test_an_unknown_action_is_refused(kind, action):
    env = made(kind)
    env.reset(seed=0)
    with pytest.raises((AssertionError, ValueError), match="invalid|from 0 to"):
        env.step(action)


# Pictures


@each
@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("mode", ["human", "rgb_array", "rgb_array_list"])
def test_rendering_changes_no_episode(kind, mode):
    if mode not in KINDS[kind][1]().metadata["render_modes"]:
        return
    env, actions = made(kind, render_mode=mode), actions_of(kind, 3, 12)
    assert play(env, 3, actions) == play(made(kind), 3, actions)
    env.close()
