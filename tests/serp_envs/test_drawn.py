"""What all the small environments of our own promise: Gymnasium's rules, repetition, pictures."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp_envs import Hill, Landing, SwingUp, register
from serp_envs.drawn import FORCE, DrawnEnv

IDS = {SwingUp: "serp/SwingUp-v0", Hill: "serp/Hill-v0", Landing: "serp/Landing-v0"}
each = pytest.mark.parametrize("kind", IDS, ids=lambda kind: kind.__name__)


def episode(env: gymnasium.Env[Any, Any], seed: int | None, actions: NDArray[Any]) -> list[Any]:
    """All that an episode shows, floats as their bits, until it ends or the actions do."""
    observation, info = env.reset(seed=seed)
    seen: list[Any] = [(observation.tobytes(), info)]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated or truncated:
            break
    return seen


def actions_of(kind: type[DrawnEnv], seed: int, count: int) -> NDArray[np.int64]:
    assert isinstance(kind().action_space, spaces.Discrete)
    return np.random.default_rng(seed).integers(0, kind().action_space.n, count)


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Pygame draws without a display."""
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    yield


@each
@pytest.mark.usefixtures("no_screen")
def test_gymnasiums_checker_has_nothing_to_say(kind: type[DrawnEnv]) -> None:
    register()
    check_env(gymnasium.make(IDS[kind]).unwrapped)


@each
def test_it_is_registered_with_a_limit_and_what_counts_as_solved(kind: type[DrawnEnv]) -> None:
    env = gymnasium.make(f"serp_envs:{IDS[kind]}")
    assert isinstance(env.unwrapped, kind)
    assert env.spec is not None
    assert env.spec.max_episode_steps == 200
    module = __import__(kind.__module__, fromlist=["SOLVED"])
    assert env.spec.reward_threshold == module.SOLVED


@each
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_equal_seeds_give_equal_episodes_also_on_a_used_object(
    kind: type[DrawnEnv], seed: int
) -> None:
    actions = actions_of(kind, seed, 60)
    used = kind()
    first = episode(used, seed, actions)
    assert episode(used, seed, actions) == first
    assert episode(kind(), seed, actions) == first


@each
def test_episodes_go_on_from_one_seed_without_repeating(kind: type[DrawnEnv]) -> None:
    def run() -> list[Any]:
        env = kind()
        return [episode(env, 7 if k == 0 else None, actions_of(kind, k, 20)) for k in range(5)]

    first = run()
    assert run() == first
    assert len({seen[0][0] for seen in first}) == 5


@each
def test_global_generators_are_neither_read_nor_moved(kind: type[DrawnEnv]) -> None:
    random.seed(3)
    np.random.seed(3)
    before = random.getstate(), repr(np.random.get_state())
    first = episode(kind(), 5, actions_of(kind, 5, 30))
    assert (random.getstate(), repr(np.random.get_state())) == before
    np.random.seed(4)
    assert episode(kind(), 5, actions_of(kind, 5, 30)) == first


@each
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), sticky=st.integers(1, 40))
def test_every_observation_is_in_the_space(kind: type[DrawnEnv], seed: int, sticky: int) -> None:
    """Also where one action is held for long."""
    env = kind()
    observation, _ = env.reset(seed=seed)
    for action in np.repeat(actions_of(kind, seed, 200 // sticky + 1), sticky):
        assert observation.dtype == np.float32
        assert env.observation_space.contains(observation)
        observation, _, terminated, _, _ = env.step(action)
        if terminated:
            assert env.observation_space.contains(observation)
            break


@each
@pytest.mark.parametrize("action", [4, -1, 0.5, None])
def test_an_unknown_action_is_refused(kind: type[DrawnEnv], action: Any) -> None:
    env = kind()
    env.reset(seed=0)
    with pytest.raises(AssertionError, match="invalid"):
        env.step(action)


# Rendering


@each
def test_an_unknown_render_mode_is_refused(kind: type[DrawnEnv]) -> None:
    with pytest.raises(ValueError, match="render_mode"):
        kind(render_mode="ansi")


@each
@pytest.mark.usefixtures("no_screen")
def test_the_picture_follows_what_happens(kind: type[DrawnEnv]) -> None:
    env = kind(render_mode="rgb_array")
    env.reset(seed=1)

    def picture() -> NDArray[np.uint8]:
        found = env.render()
        assert isinstance(found, np.ndarray)
        assert (found.shape, found.dtype) == ((400, 600, 3), np.uint8)
        return found

    def pushed(shown: NDArray[np.uint8]) -> bool:
        return bool(np.all(shown == FORCE, axis=2).any())

    before = picture()
    assert not pushed(before)
    assert np.array_equal(picture(), before)
    for _ in range(5):
        env.step(2)
    assert pushed(picture())
    assert not np.array_equal(picture(), before)
    env.close()
    assert not np.array_equal(picture(), before)  # closing loses nothing but the surface
    env.close()


@each
@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("mode", ["human", "rgb_array"])
def test_rendering_changes_no_episode(
    kind: type[DrawnEnv], mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(kind.metadata, "render_fps", 0)  # no waiting
    env = gymnasium.make(f"serp_envs:{IDS[kind]}", render_mode=mode)
    actions = actions_of(kind, 3, 15)
    assert episode(env, 3, actions) == episode(kind(), 3, actions)
    env.close()
