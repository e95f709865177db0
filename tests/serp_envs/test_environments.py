"""Properties of all environments: Gymnasium's rules, exact repetition, snapshots, pictures."""

from __future__ import annotations

import json
import math
import random
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

import serp_envs
from serp_envs.drawn import FORCE
from tests.serp_envs.common import KINDS, SMALL, actions_of, bits, go_on, play

each = pytest.mark.parametrize("kind", KINDS)
DRAWN = ("hill", "landing", "swing-up")
SAVED = [kind for kind in KINDS if kind not in DRAWN]
SOCCER = [kind for kind in SAVED if kind != "cartpole"]
seeds = st.integers(0, 2**32 - 1)


def made(kind: str, **options: Any) -> Any:
    """An environment that draws without waiting for the clock."""
    if kind in SOCCER:
        return KINDS[kind][1](**options, real_time=False)
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
def test_it_is_registered_with_its_limits_and_again_where_it_was_removed(
    name: str, steps: int | None, threshold: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = gymnasium.registry[name]
    assert (spec.max_episode_steps, spec.reward_threshold) == (steps, threshold)
    serp_envs.register()
    assert gymnasium.registry[name] is spec
    monkeypatch.delitem(gymnasium.registry, name)
    serp_envs.register()
    assert gymnasium.make(name).spec is not None


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
def test_neither_global_generators_nor_other_environments_matter(kind: str) -> None:
    actions = actions_of(kind, 5, 30)
    random.seed(3)
    np.random.seed(3)
    before = random.getstate(), repr(np.random.get_state())
    first = play(made(kind), 5, actions)
    assert (random.getstate(), repr(np.random.get_state())) == before
    random.seed(4)
    np.random.seed(4)
    env, other = made(kind), made(kind)
    together = [bits(env.reset(seed=5))]
    for action in actions:
        other.reset(seed=9)
        other.step(1)
        together += go_on(env, np.array([action]))
    assert together == first


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


# Snapshots


@pytest.mark.parametrize("kind", SAVED)
@settings(max_examples=12, deadline=None)
@given(seed=seeds, cut=st.integers(-1, 25), into_used=st.booleans())
def test_a_snapshot_through_json_continues_exactly(
    kind: str, seed: int, cut: int, into_used: bool
) -> None:
    """Before the first reset (cut −1), in an episode, and right after its end."""
    actions = actions_of(kind, seed, 60)
    env, undisturbed, other = made(kind), made(kind), made(kind)

    def begin(one: Any) -> bool:
        """Play up to the cut; return whether the episode goes on from there."""
        if cut < 0:
            return False
        one.reset(seed=seed)
        return all(not any(one.step(int(action))[2:4]) for action in actions[:cut])

    def rest(one: Any) -> list[Any]:
        start = [] if running else [bits(one.reset(seed=seed if cut < 0 else None))]
        return [*start, *go_on(one, actions[max(cut, 0) :])]

    running = begin(env)
    begin(undisturbed)
    text = json.dumps(env.state_dict(), allow_nan=False)
    if into_used:
        play(other, seed + 1, actions)
    other.load_state_dict(json.loads(text))
    assert json.dumps(other.state_dict()) == text
    expected = rest(undisturbed)
    assert rest(env) == expected
    assert rest(other) == expected


def clock(**values: Any) -> dict[str, Any]:
    return {"clock": {"game": 0, "contest": 0, "seconds": 0.0, **values}}


GENERATOR = {"bit_generator": "PCG64", "state": {"state": 1}}


@pytest.mark.parametrize(
    ("kind", "change", "says"),
    [
        *((kind, {"extra": 1}, "snapshot") for kind in SAVED),
        *((kind, {"np_random": None}, "np_random") for kind in SAVED),
        *((kind, {"np_random": {"bit_generator": "MT19937"}}, "np_random") for kind in SAVED),
        *((kind, {"np_random": GENERATOR}, "np_random") for kind in SAVED),
        ("cartpole", {"angle_limit": 0.3}, "angle_limit"),
        ("cartpole", {"track_limit": 1.0}, "track_limit"),
        ("cartpole", {"state": [1.0, 2.0]}, "four finite numbers"),
        ("cartpole", {"state": [0.0, 0.0, math.nan, 0.0]}, "four finite numbers"),
        ("cartpole", {"state": "upright"}, "four numbers"),
        ("cartpole", {"steps_beyond_terminated": -1}, "steps_beyond_terminated"),
        ("soccer", {"field": "hsl-small-2026"}, "plays"),
        ("corner-kick", {"scenario": "Contest"}, "plays"),
        ("soccer", {"actions": [5]}, "actions"),
        ("soccer", {"actions": "0"}, "actions"),
        ("soccer", {"actions": [1] * 100}, "ends with action"),
        ("soccer", {"clock": {"game": 0}}, "clock"),
        ("soccer", {"clock": None}, "clock"),
        *(
            ("soccer", clock(seconds=seconds), "seconds")
            for seconds in (-1.0, math.nan, math.inf, 10**400)
        ),
    ],
)
def test_a_bad_snapshot_is_refused_and_changes_nothing(
    kind: str, change: dict[str, Any], says: str
) -> None:
    env, unharmed = made(kind), made(kind)
    for one in (env, unharmed):
        one.reset(seed=1)
        one.step(1)
    before = env.state_dict()
    with pytest.raises(ValueError, match=says):
        env.load_state_dict({**before, **change})
    assert env.state_dict() == before
    actions = actions_of(kind, 4, 40)
    assert go_on(env, actions) == go_on(unharmed, actions)


@pytest.mark.parametrize("kind", SAVED)
def test_an_empty_snapshot_is_refused(kind: str) -> None:
    with pytest.raises(ValueError, match="snapshot"):
        made(kind).load_state_dict({})


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
