"""The corner kick: its rules, and both sides alike."""

from __future__ import annotations

import math

import numpy as np
import pytest

from serp_envs import CornerKickDefender
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World
from serp_envs.soccer.referee import Referee


def test_the_ball_lies_at_a_corner_of_the_own_side_until_it_is_kicked() -> None:
    env = CornerKickDefender()
    sides = set()
    for seed in range(20):
        _, info = env.reset(seed=seed)
        assert info["ball_x"] == pytest.approx(-4.45)
        assert info["ball_y"] == pytest.approx(2.95 * info["corner"])
        waited = 0
        while not info["kicked"]:
            assert math.hypot(info["ball_vx"], info["ball_vy"]) == 0.0
            _, _, terminated, truncated, info = env.step(2)
            assert not (terminated or truncated)
            waited += 1
        assert 2 <= waited <= 8  # 1 to 3 s
        assert info["ball_vy"] * info["corner"] < 0.0
        sides.add(info["corner"])
    assert sides == {1.0, -1.0}


def placed(
    ball: tuple[float, float], defender: tuple[float, float], attacker: tuple[float, float]
) -> CornerKick:
    """A corner that was taken, in that situation; the ball is between defender and far away."""
    corner = CornerKick(SPL_2020)
    corner.start(np.random.default_rng(0))
    poses = [(*place, 0.0) for place in (defender, attacker, (4.0, 2.0))]
    corner.world = corner.attack.world = World(SPL_2020, NAO, ball, poses)
    corner.attack.kicked = True
    corner.referee = Referee(corner.world)
    return corner


def test_a_clearance_that_rolls_away_is_cleared_and_another_ball_is_not() -> None:
    rng = np.random.default_rng(0)
    for kicks in (True, False):
        corner = placed((-3.0, 0.0), (-3.22, 0.0), (-3.0, 2.0))
        if kicks:
            corner._clear(corner.world.robots[0], rng)
        else:
            corner.world.kick(0.0, 1.1, rng)
        ended = None
        for _ in range(40):
            corner.world.robots[0].stop()
            corner.world.advance()
            ruling = corner.judge()
            ended = ended or (ruling.outcome if ruling else None)
        assert ended == ("cleared" if kicks else None)


def test_corners_of_both_sides_look_alike() -> None:
    one = placed((-3.5, 1.0), (-4.0, 0.4), (-3.0, 1.3))
    other = placed((-3.5, -1.0), (-4.0, -0.4), (-3.0, -1.3))
    one.attack.side, other.attack.side = 1.0, -1.0
    assert one.observe() == pytest.approx(other.observe(), abs=1e-6)
    assert one.reward() == pytest.approx(other.reward())
