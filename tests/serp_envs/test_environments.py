"""Properties of all environments: Gymnasium's rules, exact repetition, pictures."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

import serp_envs
from serp_envs.drawn import FORCE
from tests.serp_envs.common import KINDS, SMALL, actions_of, bits, play

each = pytest.mark.parametrize("kind", KINDS)
DRAWN = ("hill", "landing", "swing-up")
SOCCER = [kind for kind in KINDS if "soccer" in kind or "corner" in kind]
seeds = st.integers(0, 2**32 - 1)


def made(kind: str, **options: Any) -> Any:
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
def test_gymnasiums_checker_has_nothing_to_say(kind: str) -> None:
    options = SMALL if "small" in kind else {}
    check_env(gymnasium.make(f"serp_envs:{KINDS[kind][0]}", **options).unwrapped)


@pytest.mark.parametrize(
    ("name", "steps", "threshold"),
    [
        ("serp/CartPole-v0", 500, 475.0),
        ("serp/Hill-v0", 200, serp_envs.hill.SOLVED),
        ("serp/Landing-v0", 200, serp_envs.landing.SOLVED),
        ("serp/SwingUp-v0", 200, serp_envs.swing_up.SOLVED),
        ("serp/SoccerDefender-v0", None, None),
        ("serp/CornerKick-v0", None, None),
    ],
)
def test_it_is_registered_with_its_limits(
    name: str, steps: int | None, threshold: float | None
) -> None:
    spec = gymnasium.registry[name]
    assert (spec.max_episode_steps, spec.reward_threshold) == (steps, threshold)


@each
@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_equal_seeds_give_equal_episodes_also_on_a_used_object(kind: str, seed: int) -> None:
    actions = actions_of(kind, seed, 50)
    options = {"game": 0} if kind in SOCCER else {}
    used = made(kind)
    first = play(used, seed, actions, **options)
    play(used, seed + 1, actions)
    assert play(used, seed, actions, **options) == first
    assert play(made(kind), seed, actions) == first


@each
def test_episodes_of_one_seed_differ(kind: str) -> None:
    env = made(kind)
    starts = {bits(env.reset(seed=7 if k == 0 else None))[0] for k in range(5)}
    assert len(starts) == 5


@each
@settings(max_examples=10, deadline=None)
@given(seed=seeds, sticky=st.integers(1, 40))
def test_every_observation_is_in_the_space(kind: str, seed: int, sticky: int) -> None:
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
def test_an_unknown_action_is_refused(kind: str, action: Any) -> None:
    env = made(kind)
    env.reset(seed=0)
    with pytest.raises((AssertionError, ValueError), match="invalid|from 0 to"):
        env.step(action)


# Pictures


@each
def test_an_unknown_render_mode_is_refused(kind: str) -> None:
    if kind != "cartpole":  # Gymnasium's own, which accepts any
        with pytest.raises(ValueError, match="render_mode"):
            made(kind, render_mode="ansi")


@each
@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("mode", ["human", "rgb_array", "rgb_array_list"])
def test_rendering_changes_no_episode(kind: str, mode: str) -> None:
    if mode not in KINDS[kind][1]().metadata["render_modes"]:
        return
    env, actions = made(kind, render_mode=mode), actions_of(kind, 3, 12)
    assert play(env, 3, actions) == play(made(kind), 3, actions)
    env.close()


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("kind", DRAWN)
def test_the_picture_follows_what_happens(kind: str) -> None:
    env = made(kind, render_mode="rgb_array")
    env.reset(seed=1)
    before = env.render()
    assert (before.shape, before.dtype) == ((400, 600, 3), np.uint8)
    assert not np.all(before == FORCE, axis=2).any()
    assert np.array_equal(env.render(), before)
    for _ in range(5):
        env.step(2)
    after = env.render()
    assert np.all(after == FORCE, axis=2).any()
    assert not np.array_equal(after, before)
    env.close()
    assert np.array_equal(env.render(), after)  # closing loses nothing but the surface
    env.close()
