"""The physics: rolling, walking, kicks; both ways into pymunk."""

from __future__ import annotations

import math

import numpy as np
import pytest

from serp_envs.soccer.fields import FIELDS, SPL_2020, Field
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World

FAR = ((-4.0, 2.5, 0.0), (4.0, -2.5, 0.0))


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_a_rolling_ball_slows_down_by_the_carpets_deceleration(field: Field) -> None:
    world = World(field, NAO, (0.0, 0.0), FAR)
    world.kick(0.0, 1.5, np.random.default_rng(0))
    speed = world.ball_vx
    assert 1.35 <= speed <= 1.65
    for _ in range(10):
        world.advance()
    assert world.ball_vx == pytest.approx(speed - 0.30, abs=1e-9)
    assert world.ball_vy == 0.0
    for _ in range(60):
        world.advance()
    assert (world.ball_vx, world.ball_vy) == (0.0, 0.0)
    assert world.ball_x == pytest.approx(speed**2 / 0.6, rel=0.02)


@pytest.mark.parametrize(
    ("target", "speed"), [((3.0, 0.0), 0.25), ((-3.0, 0.0), 0.15), ((0.0, 3.0), 0.20)]
)
def test_walks_keep_to_the_limits_of_their_direction(
    target: tuple[float, float], speed: float
) -> None:
    world = World(SPL_2020, NAO, (0.0, 2.9), ((0.0, 0.0, 0.0), FAR[1]))
    robot = world.robots[0]
    for _ in range(20):
        robot.go_to(*target, robot.x + 1.0, robot.y)  # keeps looking along x
        world.advance()
    start = (robot.x, robot.y)
    for _ in range(10):
        robot.go_to(*target, robot.x + 1.0, robot.y)
        world.advance()
    assert math.dist(start, (robot.x, robot.y)) == pytest.approx(speed, rel=1e-3)


def test_a_shot_does_not_pass_a_robot() -> None:
    world = World(SPL_2020, NAO, (0.0, 0.0), ((-1.0, 0.0, 0.0), FAR[1]))
    world.kick(math.pi, 1.5, np.random.default_rng(0))
    for _ in range(15):
        world.advance()
    assert world.ball_vx > -1e-9
    assert world.ball_x > -0.82  # touching, and a little overlap
