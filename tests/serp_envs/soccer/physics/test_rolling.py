"""Predictions of a rolling ball against the physics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from serp_envs.soccer.fields import FIELDS, Field
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.rolling import meeting, way
from serp_envs.soccer.physics.world import World


def world_of(field: Field) -> World:
    world = World(field, NAO, (0.0, 0.0), ((1.0, 0.6, -1.0), (4.0, -2.5, 0.0)))
    world.kick(0.3, 1.0, np.random.default_rng(0))
    return world


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
@pytest.mark.parametrize("seconds", [0.0, 1.0, 6.0])
def test_the_ball_comes_where_it_is_said_to_come(field: Field, seconds: float) -> None:
    world = world_of(field)
    vx, vy, slowing = world.ball_vx, world.ball_vy, field.ball_deceleration
    speed = math.hypot(vx, vy)
    far = way(min(seconds, speed / slowing), speed, slowing)
    for _ in range(round(10 * seconds)):
        world.advance()
    assert (world.ball_x, world.ball_y) == pytest.approx((far * vx, far * vy), abs=0.02)


def test_a_robot_that_walks_to_the_meeting_point_meets_the_ball() -> None:
    world = world_of(FIELDS["spl-2020"])
    robot = world.robots[0]
    _, _, seconds = meeting(world, robot)
    assert 0.4 < seconds < 3.0
    nearest = math.inf
    for _ in range(round(10 * seconds) + 8):
        x, y, _ = meeting(world, robot)
        robot.go_to(x, y, world.ball_x, world.ball_y)
        world.advance()
        distance = math.hypot(robot.x - world.ball_x, robot.y - world.ball_y)
        nearest = min(nearest, distance)
    assert nearest < world.reach


def test_a_ball_at_rest_is_met_where_it_is() -> None:
    world = World(FIELDS["spl-2020"], NAO, (0.0, 0.0), ((1.2, 0.0, 0.0), (4.0, -2.5, 0.0)))
    assert meeting(world, world.robots[0]) == pytest.approx((0.0, 0.0, 4.0))
