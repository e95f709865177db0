"""The five actions of the defender, as controllers of a robot."""

from __future__ import annotations

from math import atan2, hypot, radians
from typing import Final

import numpy as np

from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import ticks
from serp_envs.soccer.physics.robot import Robot
from serp_envs.soccer.physics.world import World

COVER_MARGIN: Final = 0.22
"""The covering robot stands contact + this from the ball, m."""
PUSH_TURN: Final = radians(50.0)
"""How far to the side of the robot's line the ball is pushed, rad."""
PUSH_SIGMA: Final = radians(10.0)
"""Standard deviation of the direction of a push, rad."""
PUSH_SPEED: Final = 0.55
"""m/s."""
FRONT: Final = 0.7
"""The ball can be kicked within ± this of the heading, rad."""
KICK_COOLDOWN: Final = ticks(0.6)
SLOW_MARGIN: Final = 0.15
"""A frontal contrast slows down within contact + this of the ball, m …"""
SLOW_PACE: Final = 0.7
"""… to this share of full speed: faster, it would outrun the attacker."""
CHARGE_PACE: Final = 1.4
"""A charge is this much faster than a walk."""
HIT_GAP: Final = 0.10
"""A charge does damage when the gap between the robots is below this, m …"""
HIT_FRONT: Final = 0.6
"""… and the opponent within ± this of the heading, rad."""
OPPONENT_FALLS: Final = 0.7
"""Probability that a hit fells the opponent."""
CHARGER_FALLS: Final = 0.2
"""Probability that a hit fells the robot that charged."""
DOWN: Final = ticks(4.0)
HIT_COOLDOWN: Final = ticks(1.0)
SHOVE_TURN: Final = 0.8
"""A charge that meets the ball kicks it anywhere within ± this of the robot's line, rad."""
SHOVE_SPEED: Final = 0.6
"""m/s."""


def ball_in_front(world: World, robot: Robot) -> float | None:
    """Return the direction to the ball, rad, if the robot can kick it now; else None."""
    if robot.kick_ready > world.tick:
        return None
    dx, dy = world.ball_x - robot.x, world.ball_y - robot.y
    if hypot(dx, dy) >= world.reach:
        return None
    bearing = atan2(dy, dx)
    return bearing if -FRONT < wrap(bearing - robot.heading) < FRONT else None


def cover_goal(world: World, robot: Robot) -> None:
    """Walk to a point on the line from the ball to the goal centre, facing the ball."""
    x, y = world.ball_x, world.ball_y
    dx, dy = world.goal_x - x, -y
    share = (world.contact + COVER_MARGIN) / max(hypot(dx, dy), 1e-9)
    robot.go_to(x + share * dx, y + share * dy, x, y)


def side_advance(world: World, robot: Robot, side: float, rng: np.random.Generator) -> None:
    """Walk straight to the ball and push it past the opponent, +1 to the left, −1 to the right."""
    x, y = world.ball_x, world.ball_y
    robot.go_to(x, y, x, y)
    bearing = ball_in_front(world, robot)
    if bearing is not None:
        world.kick(rng.normal(bearing + side * PUSH_TURN, PUSH_SIGMA), PUSH_SPEED, rng, robot)
        robot.kick_ready = world.tick + KICK_COOLDOWN


def frontal_contrast(world: World, robot: Robot) -> None:
    """Walk into the ball, slower at the end, and do not kick."""
    x, y = world.ball_x, world.ball_y
    near = hypot(x - robot.x, y - robot.y) < world.contact + SLOW_MARGIN
    robot.go_to(x, y, x, y, SLOW_PACE if near else 1.0)


def charge(world: World, robot: Robot, opponent: Robot, rng: np.random.Generator) -> bool:
    """Run into the opponent; return whether that did damage now.

    An opponent that is down is not charged: the robot only walks up to it.
    """
    robot.go_to(opponent.x, opponent.y, opponent.x, opponent.y, CHARGE_PACE)
    tick = world.tick
    if opponent.down_until > tick:
        return False
    bearing = ball_in_front(world, robot)
    if bearing is not None:
        spread = rng.uniform(-SHOVE_TURN, SHOVE_TURN)
        world.kick(bearing + spread, SHOVE_SPEED, rng, robot)
        robot.kick_ready = tick + KICK_COOLDOWN
    if robot.hit_ready > tick:
        return False
    dx, dy = opponent.x - robot.x, opponent.y - robot.y
    if hypot(dx, dy) >= robot.walk.radius + opponent.walk.radius + HIT_GAP:
        return False
    off = wrap(atan2(dy, dx) - robot.heading)
    if not -HIT_FRONT < off < HIT_FRONT:
        return False
    robot.hit_ready = tick + HIT_COOLDOWN
    if rng.random() < OPPONENT_FALLS:
        opponent.down_until = tick + DOWN
    if rng.random() < CHARGER_FALLS:
        robot.down_until = tick + DOWN
    return True


def close_in(world: World, robot: Robot) -> None:
    """Walk to the ball, as the defender does before a contest begins."""
    x, y = world.ball_x, world.ball_y
    robot.go_to(x, y, x, y)
