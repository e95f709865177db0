"""Where a rolling ball will be, and where a robot can meet it."""

from __future__ import annotations

from math import hypot
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from serp_envs.soccer.robot import Robot
from serp_envs.soccer.world import World

LOOK: Final = 0.2
"""The way ahead is looked at in steps of this, s."""
STILL: Final = 1e-6
"""A slower ball lies, m/s."""

Number = TypeVar("Number", float, NDArray[np.floating[Any]])


def way(time: Number, speed: Number, slowing: float) -> Number:
    """How far a ball rolls in that time, as the seconds it would take at its present speed.

    Args:
        time: s, not longer than it rolls: speed / slowing.
        speed: m/s, not 0. Floats, or arrays that fit to each other.
        slowing: What rolling costs it, m/s².
    """
    return time * (1.0 - 0.5 * slowing * time / speed)


def rolled(world: World, seconds: float) -> tuple[float, float]:
    """Where the ball will be then, m, if nobody meets it."""
    vx, vy = world.ball_vx, world.ball_vy
    speed = hypot(vx, vy)
    if speed < STILL:
        return world.ball_x, world.ball_y
    slowing = world.field.ball_deceleration
    far = way(min(seconds, speed / slowing), speed, slowing)
    return world.ball_x + far * vx, world.ball_y + far * vy


def meeting(world: World, robot: Robot) -> tuple[float, float, float]:
    """The first place on the ball's way that the robot reaches no later than the ball.

    Returns:
        x and y, m, and the seconds until then. Where the robot comes too late for a moving ball it
        is the place where the ball comes to rest.
    """
    pace, contact = robot.walk.forward, world.contact
    x, y, vx, vy = world.ball_x, world.ball_y, world.ball_vx, world.ball_vy
    from_x, from_y = x - robot.x, y - robot.y
    speed, slowing = hypot(vx, vy), world.field.ball_deceleration
    if speed < STILL:
        return x, y, max(0.0, hypot(from_x, from_y) - contact) / pace
    end = speed / slowing
    time = 0.0
    while True:
        far = way(time if time < end else end, speed, slowing)
        dx, dy = far * vx, far * vy
        needed = (hypot(from_x + dx, from_y + dy) - contact) / pace
        if needed <= time or time >= end:
            return x + dx, y + dy, max(time, needed)
        time += LOOK
