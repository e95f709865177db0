"""The approach before a contest: a random situation, then both robots walk to the ball."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin
from typing import Final

import numpy as np

from serp_envs.soccer.actions import close_in
from serp_envs.soccer.fields import Field
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.geometry import along
from serp_envs.soccer.physics.periods import ticks
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World

CONTEST_RADIUS: Final = 0.70
"""Within this distance of the ball both robots contest it, m (paper, section 4.2)."""
BALL_X: Final = (-3.0, -0.8)
"""Where the ball lies at first, m."""
BALL_Y: Final = (-1.6, 1.6)
"""See `BALL_X`."""
ATTACKER_DISTANCE: Final = (0.3, 0.7)
"""From the ball, on the far side of it, m."""
DEFENDER_DISTANCE: Final = (0.9, 1.6)
"""From the ball, on the goal's side of it, m."""
SPREAD: Final = 0.9
"""Both stand within ± this of the line from the ball to the goal centre, rad at the ball."""
GOAL_LINE_GAP: Final = 0.1
"""The defender does not start nearer to its goal line than this, m."""
PATIENCE: Final = ticks(10.0)
"""An approach longer than this has failed."""


def approach(field: Field, rng: np.random.Generator) -> tuple[World, Attacker]:
    """Play approaches until one of them ends in a contest.

    Args:
        field: The pitch.
        rng: Draws the situations and the attacker's decisions.

    Returns:
        A world in which both robots, the defender first, are within `CONTEST_RADIUS` of the ball;
        its `tick` is the length of the approach. And the policy of the second robot.
    """
    while True:
        world = _situation(field, rng)
        if world is None:
            continue
        defender, opponent = world.robots
        attacker = Attacker(world, opponent)
        attacker.may_shoot = False
        while world.tick < PATIENCE and _inside(world):
            if _contested(world):
                attacker.may_shoot = True
                return world, attacker
            close_in(world, defender)
            attacker.act(world, defender, rng)
            world.advance()


def _situation(field: Field, rng: np.random.Generator) -> World | None:
    """Ball, defender and attacker somewhere; None where the defender would not fit."""
    u = rng.random(6).tolist()
    ball_x, ball_y = along(BALL_X, u[0]), along(BALL_Y, u[1])
    goalwards = atan2(-ball_y, field.own_goal_x - ball_x)
    distance = along(DEFENDER_DISTANCE, u[2])
    angle = goalwards + SPREAD * (2.0 * u[3] - 1.0)
    x, y = ball_x + distance * cos(angle), ball_y + distance * sin(angle)
    if x < field.own_goal_x + GOAL_LINE_GAP:
        return None
    defender = (x, y, atan2(ball_y - y, ball_x - x))
    distance = along(ATTACKER_DISTANCE, u[4])
    angle = goalwards + pi + SPREAD * (2.0 * u[5] - 1.0)
    x, y = ball_x + distance * cos(angle), ball_y + distance * sin(angle)
    attacker = (x, y, atan2(ball_y - y, ball_x - x))
    return World(field, NAO, (ball_x, ball_y), (defender, attacker))


def _contested(world: World) -> bool:
    x, y = world.ball_x, world.ball_y
    return all([hypot(robot.x - x, robot.y - y) < CONTEST_RADIUS for robot in world.robots])


def _inside(world: World) -> bool:
    goal_x = world.goal_x
    return goal_x < world.ball_x < -goal_x and abs(world.ball_y) < 0.5 * world.field.width
