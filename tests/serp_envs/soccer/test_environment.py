"""The game clock."""

import json
import math

import pytest
from gymnasium.error import ResetNeeded

from serp_envs import SoccerDefender
from tests.serp_envs.common import actions_of, play


def finish(env, action=0):
    while True:
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            return info


def test_contests_fill_games_of_600_seconds_and_chain_them():
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


def test_a_saved_game_goes_on_with_its_next_contest():
    env, other = SoccerDefender(), SoccerDefender()
    env.reset(seed=0)
    finish(env)
    other.reset(seed=5)
    other.load_state_dict(json.loads(json.dumps(env.state_dict(), allow_nan=False)))
    with pytest.raises(ResetNeeded, match="reset"):
        other.step(0)
    actions = actions_of("soccer", 2, 100)
    assert play(other, 4, actions) == play(env, 4, actions)


@pytest.mark.parametrize(
    "change",
    [
        {"game": -1},
        {"contest": True},
        {"more": 1},
        *({"seconds": seconds} for seconds in (-1.0, math.nan, math.inf, 10**400)),
    ],
)
def test_a_bad_clock_is_refused_and_changes_nothing(change):
    env = SoccerDefender()
    env.reset(seed=1)
    before = env.state_dict()
    with pytest.raises(ValueError, match="game"):
        env.load_state_dict({**before, **change})
    assert env.state_dict() == before
