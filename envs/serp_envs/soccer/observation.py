"""The defender's observation: 16 numbers in a frame centred on the ball, the goal along x."""

from __future__ import annotations

from math import cos, hypot, sin
from typing import Final, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp_envs.soccer.opponents.attacker import WIND_UP
from serp_envs.soccer.physics.world import World

NEAR: Final = 0.5
"""The unit of the robots' places, m."""
FAR: Final = 3.0
"""The unit of the distance to the goal, m."""
WIDE: Final = 2.0
"""The unit of the ball's y, m."""

FASTEST: Final = 3.0
"""Largest component of the ball's velocity, m/s; no kick comes near it, an odd bounce might."""

# From a ball on the pitch to a robot anywhere on the carpet it is 11.8 m at most, and 9.5 m from
# the goal to a ball: the bounds leave room for what rolls or slips on. Velocities are cut off.
_BOUNDS: Final = (
    *((-25.0, 25.0),) * 4,
    *((-FASTEST, FASTEST),) * 2,
    *((-1.0, 1.0),) * 4,
    (0.0, 4.0),
    (-2.0, 2.0),
    *((0.0, 1.0),) * 4,
)
_LOW: Final = np.array([low for low, _ in _BOUNDS], dtype=np.float32)
_HIGH: Final = np.array([high for _, high in _BOUNDS], dtype=np.float32)

SPACE: Final[spaces.Space[NDArray[np.float32]]] = cast(
    spaces.Space[NDArray[np.float32]], spaces.Box(_LOW, _HIGH, dtype=np.float32)
)
"""The space of the observations."""


def observe(world: World, wind_up: float, secure_timer: float) -> NDArray[np.float32]:
    """Return the defender's observation.

    Args:
        world: With the defender as its first robot and the attacker as its second.
        wind_up: For how long the attacker has been winding up, s.
        secure_timer: For how long the ball has been as good as secured, s.

    Returns:
        float32 of shape `(16,)`: x, y of the defender and of the attacker from the ball, in half
        metres; the ball's velocity, m/s; cosine and sine of the defender's and of the attacker's
        heading; the ball's distance from the goal centre in units of 3 m; the ball's y on the pitch
        in units of 2 m; the wind-up from 0 to 1; 1 while the attacker is down, 1 while the defender
        is down; the secure timer, 0 to 1 s. x points from the ball to the goal centre.
    """
    ball_x, ball_y = world.ball_x, world.ball_y
    defender, attacker = world.robots
    goal_x, goal_y = world.goal_x - ball_x, -ball_y
    distance = hypot(goal_x, goal_y)
    scale = 1.0 / distance if distance > 0.0 else 0.0
    c, s = goal_x * scale, goal_y * scale
    near_c, near_s = c / NEAR, s / NEAR
    dx, dy = defender.x - ball_x, defender.y - ball_y
    ax, ay = attacker.x - ball_x, attacker.y - ball_y
    vx, vy = world.ball_vx, world.ball_vy
    dc, ds = cos(defender.heading), sin(defender.heading)
    ac, as_ = cos(attacker.heading), sin(attacker.heading)
    tick = world.tick
    return np.array(
        (
            near_c * dx + near_s * dy,
            near_c * dy - near_s * dx,
            near_c * ax + near_s * ay,
            near_c * ay - near_s * ax,
            max(-FASTEST, min(FASTEST, c * vx + s * vy)),
            max(-FASTEST, min(FASTEST, c * vy - s * vx)),
            c * dc + s * ds,
            c * ds - s * dc,
            c * ac + s * as_,
            c * as_ - s * ac,
            distance / FAR,
            ball_y / WIDE,
            wind_up / WIND_UP,
            float(attacker.down_until > tick),
            float(defender.down_until > tick),
            secure_timer,
        ),
        dtype=np.float32,
    )
