"""The path of a rolling ball, and where a robot can meet it."""

from __future__ import annotations

from math import hypot
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from serp_envs.soccer.physics.robot import Robot
from serp_envs.soccer.physics.world import World

TIME_STEP: Final = 0.2
"""The path is sampled in steps of this, s."""
STILL: Final = 1e-6
"""A ball slower than this is at rest, m/s."""

Number = TypeVar("Number", float, NDArray[np.floating[Any]])


def way(time: Number, speed: Number, slowing: float) -> Number:
    """Return how far a ball rolls in a time, as the seconds at its present speed.

    Args:
        time: s, not longer than it rolls: speed / slowing.
        speed: m/s, not 0. Floats, or arrays that fit to each other.
        slowing: What rolling costs it, m/s².
    """
    return time * (1.0 - 0.5 * slowing * time / speed)


def meeting(world: World, robot: Robot) -> tuple[float, float, float]:
    """Return the first place on the ball's path that the robot reaches no later than the ball.

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
        time += TIME_STEP
