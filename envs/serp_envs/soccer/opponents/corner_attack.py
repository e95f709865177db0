"""The attack at a corner kick: a team-mate kicks the ball in, the attacker runs to meet it."""

from __future__ import annotations

from math import atan2, cos, hypot, radians, sin, sqrt
from typing import Final

import numpy as np

from serp_envs.soccer.fields import Field
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.geometry import along
from serp_envs.soccer.physics.periods import ticks
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.rolling import meeting
from serp_envs.soccer.physics.world import Pose, World

ZONES: Final = ((0.6, 0.75), (0.6, -0.75), (1.5, 0.0))
"""Where the ball is kicked to, near post, far post, penalty spot: metres before the goal line, and
to the side of the corner in shares of half the goal."""
ZONE_SPREAD: Final = 0.25
"""A zone is that far in x and y around its middle, m."""
RUN: Final = (0.2, 0.7)
"""The attacker waits that far from where it wants the ball, m …"""
RUN_SPREAD: Final = 1.0
"""… up the pitch within ± this, rad."""
DEFENDER_X: Final = (0.4, 1.2)
"""The defender waits that far before its goal line, m …"""
DEFENDER_Y: Final = 0.7
"""… and to the side of its middle by at most this, m."""
DELAY: Final = (1.0, 3.0)
"""The corner is taken after so many seconds."""
ARRIVAL: Final = 0.3
"""The ball is meant to arrive with this speed, m/s."""
KICK_SIGMA: Final = radians(4.0)
"""Standard deviation of its direction, rad."""
RECEIVED_MARGIN: Final = 0.10
"""The attacker plays the ball once it is within contact + this, m …"""
RECEIVED_SPEED: Final = 0.2
"""… or slower than this, m/s."""


class CornerAttack:
    """The policy of the second robot of a world, the attacker, and of the third, the kicker."""

    __slots__ = ("_kick_tick", "_received", "_target", "attacker", "kicked", "side", "world")

    def __init__(self, field: Field, rng: np.random.Generator) -> None:
        """Set up a corner.

        Args:
            field: The pitch.
            rng: Draws the corner, the places, where and when the ball is kicked.
        """
        self.side = 1.0 if rng.random() < 0.5 else -1.0
        """The corner: +1 on the defender's left, −1 on its right."""
        goal_x, side = field.own_goal_x, self.side
        depth, across = ZONES[int(rng.integers(len(ZONES)))]
        u = rng.random(7).tolist()
        target_x = goal_x + depth + ZONE_SPREAD * (2.0 * u[0] - 1.0)
        target_y = side * (across * field.half_goal + ZONE_SPREAD * (2.0 * u[1] - 1.0))
        self._target = (target_x, target_y)
        ball = (goal_x + field.ball_radius, side * (0.5 * field.width - field.ball_radius))
        away, angle = along(RUN, u[2]), RUN_SPREAD * (2.0 * u[3] - 1.0)
        attacker = _facing(target_x + away * cos(angle), target_y + away * sin(angle), ball)
        defender = _facing(goal_x + along(DEFENDER_X, u[4]), DEFENDER_Y * (2.0 * u[5] - 1.0), ball)
        back = NAO.radius + field.ball_radius + 0.02
        angle = atan2(ball[1] - target_y, ball[0] - target_x)
        kicker = _facing(ball[0] + back * cos(angle), ball[1] + back * sin(angle), ball)
        self.world = World(field, NAO, ball, (defender, attacker, kicker))
        """The world of this corner."""
        self.attacker = Attacker(self.world, self.world.robots[1])
        """The policy of the attacker once it has the ball."""
        self.kicked = False
        """Whether the corner has been taken."""
        self._kick_tick = ticks(along(DELAY, u[6]))
        self._received = False

    def act(self, rng: np.random.Generator) -> None:
        """Command attacker and kicker for a tick."""
        world = self.world
        defender, robot = world.robots[0], world.robots[1]
        if not self.kicked and world.tick >= self._kick_tick:
            self._take(rng)
        if not self._received and self.kicked:
            distance = hypot(world.ball_x - robot.x, world.ball_y - robot.y)
            slow = hypot(world.ball_vx, world.ball_vy) < RECEIVED_SPEED
            self._received = slow or distance < world.contact + RECEIVED_MARGIN
        if self._received:
            self.attacker.act(world, defender, rng)
        elif self.kicked and robot.down_until <= world.tick:
            x, y, _ = meeting(world, robot)
            robot.go_to(x, y, world.ball_x, world.ball_y)
        else:
            robot.stop()

    def _take(self, rng: np.random.Generator) -> None:
        world = self.world
        dx, dy = self._target[0] - world.ball_x, self._target[1] - world.ball_y
        slowed = 2.0 * world.field.ball_deceleration * hypot(dx, dy)
        direction = rng.normal(atan2(dy, dx), KICK_SIGMA)
        world.kick(direction, sqrt(ARRIVAL * ARRIVAL + slowed), rng, world.robots[2])
        self.kicked = True


def _facing(x: float, y: float, at: tuple[float, float]) -> Pose:
    return x, y, atan2(at[1] - y, at[0] - x)
