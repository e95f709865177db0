"""The opponent's predefined policy: dribble towards the goal, shoot where a lane is open."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, radians, sin
from typing import Final

import numpy as np

from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import TICK, ticks
from serp_envs.soccer.physics.robot import Robot
from serp_envs.soccer.physics.world import World

RANGE: Final = 3.0
"""It shoots when the ball is nearer to the goal centre than this, m."""
TARGETS: Final = (0.0, 0.3, -0.3, 0.55, -0.55)
"""Where it aims: y on the goal line, m, for a goal 1.5 wide; others in proportion."""
LANE_MARGIN: Final = 0.02
"""A lane is open when the middle of the opponent is farther from it than contact + this, m."""
LANE_ENOUGH: Final = 0.6
"""More clearance than this is not worth more, m."""
TURN_COST: Final = 0.1
"""What walking round the ball costs a lane, m of clearance per rad."""
SHOT_SPEED: Final = 1.5
"""m/s."""
SHOT_SIGMA: Final = radians(4.0)
"""Standard deviation of a shot's direction, rad."""
WIND_UP: Final = 0.6
"""It stands this long with the ball in reach before a shot leaves, s."""
SHOT_COOLDOWN: Final = ticks(0.8)
TAP_SPEED: Final = 0.55
"""m/s."""
TAP_SIGMA: Final = radians(8.0)
"""Standard deviation of a tap's direction, rad."""
TAP_COOLDOWN: Final = ticks(0.5)
EVADE_DISTANCE: Final = 0.9
"""An opponent this near to the ball is dribbled round, m."""
EVADE_ANGLE: Final = 1.2
"""… when it is this near to the goal line's direction, rad at the ball."""
EVADE_TURN: Final = radians(60.0)
"""By how much a tap passes it, rad."""
WRONG_SIDE: Final = 0.15
"""Probability of passing it on the side where it stands."""
SIDE_HELD: Final = ticks(1.5)
WIDE: Final = 0.6
"""Farther out than this share of the half width it evades towards the middle only."""
GOAL_LINE_LOOK: Final = 0.15
"""It does not evade across the goal line beside the goal, looking this far ahead of the ball, m."""
STAND_MARGIN: Final = 0.10
"""Radius of the circle round the ball on which it gets behind it: contact + this, m."""
CIRCLE_STEP: Final = 1.2
"""How far ahead on that circle it aims, rad."""
ALIGNED_SHOT: Final = 0.30
"""It shoots with the ball this near to its line, rad."""
ALIGNED_TAP: Final = 0.40
"""It taps with the ball this near to its line, rad."""

_WIND_UP_TICKS: Final = ticks(WIND_UP)


class Attacker:
    """The policy of one robot of a world in one situation, tick by tick."""

    __slots__ = ("_lanes", "_shot", "_side", "_side_until", "_winding", "may_shoot", "robot")

    def __init__(self, world: World, robot: Robot) -> None:
        """Create an attacker without any decision.

        Args:
            world: Where it plays.
            robot: The robot it plays.
        """
        self.robot = robot
        self.may_shoot = True
        """Whether it shoots; without it the attacker only dribbles."""
        scale = world.field.goal_width / 1.5
        self._lanes = tuple(scale * y for y in TARGETS)
        self._side = 1.0
        self._side_until = 0
        self._winding = 0
        self._shot = 0.0

    @property
    def wind_up(self) -> float:
        """Seconds for which it has been winding up for a shot; 0 when it is not."""
        return TICK * self._winding

    def act(self, world: World, opponent: Robot, rng: np.random.Generator) -> None:
        """Command the robot for a tick.

        Args:
            world: The world, updated after the last tick.
            opponent: The opposing robot.
            rng: Draws random decisions.
        """
        robot = self.robot
        if robot.down_until > world.tick:
            self._winding = 0
            robot.stop()
            return
        x, y = world.ball_x, world.ball_y
        dx, dy = x - robot.x, y - robot.y
        distance = hypot(dx, dy)
        if self._winding:
            self._wind_up(world, distance, rng)
            return
        bearing = atan2(dy, dx)
        rival_x, rival_y = opponent.x - x, opponent.y - y
        rival = hypot(rival_x, rival_y)
        ready = robot.kick_ready <= world.tick
        goal_x = world.goal_x
        near = rival <= world.contact + LANE_MARGIN  # then it closes every lane
        if self.may_shoot and not near and hypot(x - goal_x, y) < RANGE:
            shot = self._best_shot(world, opponent, bearing)
            if shot is not None:
                aligned = self._get_behind(world, shot, bearing, ALIGNED_SHOT)
                if aligned and ready and distance < world.reach:
                    self._winding = 1
                    self._shot = shot
                    robot.stop()
                return
        direction = atan2(-y, goal_x - x)
        if rival < EVADE_DISTANCE:
            off = wrap(atan2(rival_y, rival_x) - direction)
            if -EVADE_ANGLE < off < EVADE_ANGLE:
                direction += EVADE_TURN * self._evade(world, off, direction, rng)
        aligned = self._get_behind(world, direction, bearing, ALIGNED_TAP)
        if aligned and ready and distance < world.reach:
            world.kick(rng.normal(direction, TAP_SIGMA), TAP_SPEED, rng, robot)
            robot.kick_ready = world.tick + TAP_COOLDOWN

    def _wind_up(self, world: World, distance: float, rng: np.random.Generator) -> None:
        """Go on winding up; shoot when it is time, give up when the ball is gone."""
        robot = self.robot
        robot.stop()
        if distance >= world.reach:
            self._winding = 0
        elif self._winding < _WIND_UP_TICKS:
            self._winding += 1
        else:
            self._winding = 0
            world.kick(rng.normal(self._shot, SHOT_SIGMA), SHOT_SPEED, rng, robot)
            robot.kick_ready = world.tick + SHOT_COOLDOWN

    def _best_shot(self, world: World, opponent: Robot, bearing: float) -> float | None:
        """Return the direction of the lane with the best clearance; None if all are closed."""
        x, y = world.ball_x, world.ball_y
        there_x, there_y = opponent.x - x, opponent.y - y
        depth = world.goal_x - x
        best, found = world.contact + LANE_MARGIN, None
        for target in self._lanes:
            side = target - y
            # Distance of the opponent from the segment between ball and target.
            along = (there_x * depth + there_y * side) / (depth * depth + side * side)
            along = 0.0 if along < 0.0 else 1.0 if along > 1.0 else along
            clearance = hypot(there_x - along * depth, there_y - along * side)
            if clearance <= best:
                continue
            direction = atan2(side, depth)
            turn = wrap(direction - bearing)
            clearance = LANE_ENOUGH if clearance > LANE_ENOUGH else clearance
            clearance -= TURN_COST * (turn if turn > 0.0 else -turn)
            if clearance > best:
                best, found = clearance, direction
        return found

    def _evade(self, world: World, off: float, direction: float, rng: np.random.Generator) -> float:
        """Return the side, +1 left or −1 right, on which to pass an opponent at angle `off`."""
        if world.tick >= self._side_until:
            side = -1.0 if off > 0.0 else 1.0
            self._side = -side if rng.random() < WRONG_SIDE else side
            self._side_until = world.tick + SIDE_HELD
        field, y = world.field, world.ball_y
        tap = direction + EVADE_TURN * self._side
        ahead_x = world.ball_x + GOAL_LINE_LOOK * cos(tap)
        ahead_y = y + GOAL_LINE_LOOK * sin(tap)
        too_wide = abs(y) > 0.5 * WIDE * field.width and ahead_y * y > y * y
        behind = ahead_x < world.goal_x and abs(ahead_y) > field.half_goal
        if too_wide or behind:
            self._side = -self._side
        return self._side

    def _get_behind(self, world: World, direction: float, bearing: float, tolerance: float) -> bool:
        """Walk to have the ball in a direction; return whether it is there within tolerance.

        With the ball there the robot walks into it, even against an opponent behind it.
        """
        x, y = world.ball_x, world.ball_y
        turn = wrap(wrap(direction - bearing))
        if -tolerance < turn < tolerance:
            self.robot.go_to(x, y, x, y)
            return True
        step = CIRCLE_STEP if turn > CIRCLE_STEP else -CIRCLE_STEP if turn < -CIRCLE_STEP else turn
        at = bearing + pi + step
        radius = world.contact + STAND_MARGIN
        self.robot.go_to(x + radius * cos(at), y + radius * sin(at), x, y)
        return False
