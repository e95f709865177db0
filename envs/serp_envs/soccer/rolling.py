"""Where a rolling ball will be, and where a robot can meet it."""

from __future__ import annotations

from math import hypot
from typing import Final

from serp_envs.soccer.robot import Robot
from serp_envs.soccer.world import World

LOOK: Final = 0.2
"""The way ahead is looked at in steps of this, s."""


def rolled(world: World, seconds: float) -> tuple[float, float]:
    """Where the ball will be then, m, if nobody meets it."""
    vx, vy = world.ball_vx, world.ball_vy
    speed = hypot(vx, vy)
    if speed < 1e-6:
        return world.ball_x, world.ball_y
    slowing = world.field.ball_deceleration
    time = min(seconds, speed / slowing)
    share = time * (1.0 - 0.5 * slowing * time / speed)
    return world.ball_x + share * vx, world.ball_y + share * vy


def meeting(world: World, robot: Robot) -> tuple[float, float, float]:
    """The first place on the ball's way that the robot reaches no later than the ball.

    Returns:
        x and y, m, and the seconds until then. Where the robot comes too late for a moving ball it
        is the place where the ball comes to rest.
    """
    pace = robot.walk.forward
    end = hypot(world.ball_vx, world.ball_vy) / world.field.ball_deceleration
    time = 0.0
    while True:
        x, y = rolled(world, time)
        needed = max(0.0, hypot(x - robot.x, y - robot.y) - world.contact) / pace
        if needed <= time or time >= end:
            return x, y, max(time, needed)
        time += LOOK
