"""Gymnasium's rules, exact repetition, the game clock, snapshots, pictures, real time."""

from __future__ import annotations

import json
import math
import os
import random
import time
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from serp_envs import SoccerDefender
from serp_envs.soccer.fields import FIELDS

ENV_ID = "serp_envs:serp/SoccerDefender-v0"
CLOCK = ("game", "contest", "clock")


def choices(seed: int, n: int = 120) -> list[int]:
    return [int(a) for a in np.random.default_rng(seed).integers(0, 5, n)]


def play(
    env: SoccerDefender,
    seed: int | None,
    actions: list[int],
    options: dict[str, Any] | None = None,
) -> list[Any]:
    """All that the contests show, floats as their bits, until the actions end."""
    observation, info = env.reset(seed=seed, options=options)
    seen: list[Any] = [(observation.tobytes(), info)]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated or truncated:
            observation, info = env.reset()
            seen.append((observation.tobytes(), info))
    return seen


def finish(env: SoccerDefender, action: int = 0) -> dict[str, Any]:
    while True:
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            return info


def without_clock(seen: list[Any]) -> list[Any]:
    return [
        (*step[:-1], {key: value for key, value in step[-1].items() if key not in CLOCK})
        for step in seen
    ]


@pytest.mark.parametrize("seed", range(3))
def test_two_runs_are_equal_bit_for_bit(seed: int) -> None:
    actions = choices(seed)
    assert play(SoccerDefender(), seed, actions) == play(SoccerDefender(), seed, actions)


def test_a_run_after_another_equals_the_first_but_for_the_clock() -> None:
    env = SoccerDefender()
    first = play(env, 7, choices(0))
    play(env, 8, choices(1))
    again = play(env, 7, choices(0))
    assert without_clock(again) == without_clock(first)
    assert again[0][-1]["clock"] > first[0][-1]["clock"]


def test_no_global_generator_is_touched() -> None:
    random.seed(0)
    np.random.seed(0)  # the old global one, on purpose
    before = (random.getstate(), np.random.get_state()[1].tolist())  # type: ignore[index]
    play(SoccerDefender(), 3, choices(3))
    assert (random.getstate(), np.random.get_state()[1].tolist()) == before  # type: ignore[index]


def test_an_environment_in_between_changes_nothing() -> None:
    alone = play(SoccerDefender(), 4, choices(4))
    one, other = SoccerDefender(), SoccerDefender()
    observation, info = one.reset(seed=4)
    together: list[Any] = [(observation.tobytes(), info)]
    for action in choices(4):
        other.reset(seed=9)
        other.step(3)
        observation, reward, terminated, truncated, info = one.step(action)
        together.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated or truncated:
            observation, info = one.reset()
            together.append((observation.tobytes(), info))
    assert together == alone


@pytest.mark.parametrize("field", FIELDS)
def test_contests_start_within_70_cm_and_observations_lie_in_their_space(field: str) -> None:
    env = SoccerDefender(field=field)
    env.reset(seed=0)
    ended = True
    for action in choices(2, 400):
        if ended:
            observation, info = env.reset()
            assert info["outcome"] == "playing"
            for robot in ("defender", "attacker"):
                place = (info[f"{robot}_x"], info[f"{robot}_y"])
                assert np.hypot(place[0] - info["ball_x"], place[1] - info["ball_y"]) < 0.70
        observation, _, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(observation)
        ended = terminated or truncated
        assert ended == (info["outcome"] != "playing")


def test_unsafe_choices_and_hits_are_counted_apart() -> None:
    env = SoccerDefender()
    env.reset(seed=0)
    counts = [env.step(action)[4]["unsafe_choices"] for action in (0, 4, 1, 4)]
    assert counts == [0, 1, 1, 2]
    assert env.reset()[1]["unsafe_choices"] == 0


# The game


def test_contests_fill_games_of_600_seconds_and_chain_them() -> None:
    env = SoccerDefender()
    _, info = env.reset(seed=0)
    assert (info["game"], info["contest"]) == (0, 0)
    dead = {"goal": 15.0, "out": 10.0, "secured": 5.0, "timeout": 5.0}
    contests = 0
    while info["game"] == 0:
        start = info["clock"]
        assert start < 600.0 + 10.0
        info = finish(env, contests % 4)
        end = info["clock"] + dead.get(info["outcome"], 0.0)
        assert end > start
        game, contests = info["game"], contests + 1
        _, info = env.reset()
        if info["game"] == game:
            assert end < 600.0
            assert info["contest"] == contests
            assert info["clock"] > end
        else:
            assert end >= 600.0
    assert (info["game"], info["contest"]) == (1, 0)
    assert info["clock"] < 12.0
    assert 20 <= contests <= 60


def test_a_seed_keeps_the_clock_and_new_game_opens_a_game() -> None:
    env = SoccerDefender()
    env.reset(seed=0)
    played = finish(env)["clock"]
    clock = env.reset(seed=0)[1]["clock"]
    assert clock > played > 3.0
    assert env.reset(seed=0)[1]["clock"] == clock  # an abandoned contest counts for nothing
    _, info = env.reset(seed=0, options={"new_game": True})
    assert (info["game"], info["contest"]) == (1, 0)
    assert info["clock"] < clock


def test_a_run_from_the_kick_off_of_a_game_equals_one_on_a_new_object_with_the_clock() -> None:
    env = SoccerDefender()
    play(env, 8, choices(1))
    env.reset(options={"new_game": True})
    for game in (0, 3):
        again = play(env, 7, choices(0), options={"game": game})
        assert again == play(SoccerDefender(), 7, choices(0), options={"game": game})
        assert again[0][-1]["game"] == game
    first = play(env, 7, choices(0), options={"game": 0})
    assert first == play(SoccerDefender(), 7, choices(0))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"newgame": True}, "new_game"),
        ({"game": -1}, "from 0"),
        ({"game": True}, "from 0"),
        ({"game": 1.0}, "from 0"),
        ({"game": 1, "new_game": True}, "exclude"),
    ],
)
def test_a_wrong_option_is_refused_and_changes_nothing(options: dict[str, Any], says: str) -> None:
    env = SoccerDefender()
    env.reset(seed=1)
    before = env.state_dict()
    with pytest.raises(ValueError, match=says):
        env.reset(seed=2, options=options)
    assert env.state_dict() == before


# Snapshots


def test_a_snapshot_before_the_first_contest_continues() -> None:
    one, other = SoccerDefender(), SoccerDefender()
    other.load_state_dict(json.loads(json.dumps(one.state_dict())))
    assert play(one, None, choices(1)) == play(other, None, choices(1))


@pytest.mark.parametrize("steps", [0, 1, 6])
def test_a_snapshot_in_a_contest_continues_bit_for_bit(steps: int) -> None:
    env = SoccerDefender()
    env.reset(seed=12)
    finish(env)
    _, info = env.reset()
    for _ in range(steps):
        _, _, terminated, _, info = env.step(0)
        assert not terminated
    snapshot = json.loads(json.dumps(env.state_dict()))
    rest = _bits(env.step(0))
    after = play(env, None, choices(5))
    assert rest[-1]["clock"] > info["clock"]
    for other in (SoccerDefender(), env):
        other.load_state_dict(snapshot)
        assert other.state_dict() == snapshot
        assert _bits(other.step(0)) == rest
        assert play(other, None, choices(5)) == after


def _bits(step: tuple[Any, ...]) -> tuple[Any, ...]:
    return (step[0].tobytes(), *step[1:])


def test_a_snapshot_between_contests_keeps_clock_and_generator() -> None:
    env, other = SoccerDefender(), SoccerDefender()
    env.reset(seed=2)
    finish(env)
    snapshot = json.loads(json.dumps(env.state_dict()))
    assert snapshot["actions"] is None
    other.load_state_dict(snapshot)
    with pytest.raises(ResetNeeded):
        other.step(0)
    assert play(other, None, choices(3)) == play(env, None, choices(3))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"field": "hsl-small-2026"}, "plays"),
        ({"actions": [5]}, "actions"),
        ({"actions": "0"}, "actions"),
        ({"clock": {"game": 0}}, "clock"),
        ({"clock": None}, "clock"),
        ({"clock": {"game": 0, "contest": 0, "seconds": -1.0}}, "seconds"),
        ({"clock": {"game": 0, "contest": 0, "seconds": math.nan}}, "seconds"),
        ({"clock": {"game": 0, "contest": 0, "seconds": math.inf}}, "seconds"),
        ({"clock": {"game": 0, "contest": 0, "seconds": 10**400}}, "seconds"),
        ({"np_random": {}}, "np_random"),
        ({"actions": [1] * 100}, "ends with action"),
        ({"extra": 1}, "snapshot"),
    ],
)
def test_a_bad_snapshot_is_refused_and_changes_nothing(change: dict[str, Any], says: str) -> None:
    env = SoccerDefender()
    env.reset(seed=1)
    env.step(1)
    before = env.state_dict()
    with pytest.raises(ValueError, match=says):
        env.load_state_dict({**before, **change})
    assert env.state_dict() == before
    unharmed = SoccerDefender()
    unharmed.reset(seed=1)
    unharmed.step(1)
    assert _bits(env.step(0)) == _bits(unharmed.step(0))
    assert play(env, None, choices(4)) == play(unharmed, None, choices(4))


def test_a_refused_snapshot_leaves_an_environment_without_an_episode_without_one() -> None:
    env, other = SoccerDefender(), SoccerDefender()
    other.reset(seed=1)
    before = env.state_dict()
    with pytest.raises(ValueError, match="ends with action"):
        env.load_state_dict({**other.state_dict(), "actions": [0] * 100})
    assert env.state_dict() == before
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_the_action_that_ended_the_episode_ends_a_snapshot_too() -> None:
    env = SoccerDefender()
    env.reset(seed=2)
    snapshot = env.state_dict()
    ended, taken = False, 0
    while not ended:
        _, _, terminated, truncated, _ = env.step(0)
        ended, taken = terminated or truncated, taken + 1
    with pytest.raises(ValueError, match=f"action {taken} of"):
        env.load_state_dict({**snapshot, "actions": [0] * taken})
    env.load_state_dict({**snapshot, "actions": [0] * (taken - 1)})
    assert env.step(0)[2]


# Gymnasium's rules


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    yield


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("field", FIELDS)
def test_gymnasiums_checker_has_nothing_to_say(field: str) -> None:
    check_env(gymnasium.make(ENV_ID, field=field, real_time=False).unwrapped)


def test_steps_need_a_running_contest_and_a_known_action() -> None:
    env = SoccerDefender()
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(0)
    env.reset(seed=0)
    for action in (5, -1, 0.5, None, "left"):
        with pytest.raises(ValueError, match="from 0 to 4"):
            env.step(action)  # type: ignore[arg-type]
    finish(env)
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(0)


def test_an_unknown_render_mode_is_refused() -> None:
    with pytest.raises(ValueError, match="rgb_array"):
        SoccerDefender(render_mode="ansi")


# Pictures, real time


@pytest.mark.usefixtures("no_screen")
def test_the_picture_shows_the_robots_and_the_words() -> None:
    env = SoccerDefender(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(0)
    safe = env.render()
    assert safe.dtype == np.uint8
    assert safe.shape == (768, 888, 3)
    _, _, _, _, info = env.step(4)
    picture = env.render()
    rows, columns = np.nonzero(np.all(picture == (66, 133, 244), axis=2))
    # The goal is below, 0.8 m of the other half above; the nose takes blue pixels away in front.
    assert columns.mean() == pytest.approx(120 * (3.7 - info["defender_y"]), abs=6)
    assert rows.mean() == pytest.approx(48 + 120 * (0.8 - info["defender_x"]), abs=6)
    red = np.all(picture[:48] == (255, 92, 80), axis=2).sum()
    assert red > 20 > np.all(safe[:48] == (255, 92, 80), axis=2).sum()
    env.caption = "planner"
    assert not np.array_equal(env.render(), picture)
    env.close()


@pytest.mark.usefixtures("no_screen")
def test_a_list_of_pictures_has_one_each_tick() -> None:
    env = SoccerDefender(render_mode="rgb_array_list")
    env.reset(seed=0)
    assert len(env.render()) == 1
    env.step(0)
    assert len(env.render()) == 4
    assert env.render() == []
    env.step(0)
    env.load_state_dict(env.state_dict())
    assert env.render() == []  # those of before are of another run
    env.close()


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("mode", ["human", "rgb_array", "rgb_array_list"])
def test_rendering_changes_no_contest(mode: str) -> None:
    env = SoccerDefender(render_mode=mode, real_time=False)
    assert play(env, 3, choices(3, 12)) == play(SoccerDefender(), 3, choices(3, 12))
    env.close()


def test_real_time_takes_its_time_and_changes_nothing() -> None:
    env = SoccerDefender(real_time=True)
    env.reset(seed=3)
    start = time.monotonic()
    observation = env.step(0)[0]
    assert time.monotonic() - start >= 0.39
    other = SoccerDefender()
    other.reset(seed=3)
    assert other.step(0)[0].tobytes() == observation.tobytes()
