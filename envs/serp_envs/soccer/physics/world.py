"""The physics: a pitch seen from above, a ball that rolls, robots that walk, kicks."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Final

import numpy as np
import pymunk

from serp_envs.soccer.fields import Field
from serp_envs.soccer.physics import chipmunk
from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import PHYSICS_STEP, STEPS_PER_TICK
from serp_envs.soccer.physics.robot import Robot, Walk

ITERATIONS: Final = 10
"""Of the solver, each physics step."""
REACH: Final = 0.065
"""A robot can kick a ball that it nearly touches: the gap between them is below this, m."""
KICK_SPREAD: Final = 0.1
"""The speed of a kick is uniform within ± this share."""

Pose = tuple[float, float, float]
"""x, y in metres, heading in radians."""


class World:
    """Ball and robots on a field, one situation long.

    Every situation has a new world: a pymunk space keeps contacts and joint impulses from step to
    step, so a reused one would depend on earlier situations. Positions and
    velocities are plain floats that `update` refreshes once per tick.
    """

    __slots__ = (
        "_ball",
        "_bodies",
        "_space",
        "ball_vx",
        "ball_vy",
        "ball_x",
        "ball_y",
        "contact",
        "field",
        "goal_x",
        "kicked_by",
        "reach",
        "robots",
        "tick",
    )

    ball_x: float
    ball_y: float
    ball_vx: float
    ball_vy: float

    def __init__(
        self, field: Field, walk: Walk, ball: tuple[float, float], poses: Sequence[Pose]
    ) -> None:
        """Create a world at rest.

        Args:
            field: The pitch.
            walk: The robots' legs and bodies, all alike.
            ball: Where the ball lies.
            poses: Where the robots stand, one each, in the order of `robots`.
        """
        self.field = field
        self.goal_x = field.own_goal_x
        """The x of the defended goal line."""
        self.contact = walk.radius + field.ball_radius
        """Distance from the middle of a robot to that of a ball that it touches, m."""
        self.reach = self.contact + REACH
        """The same distance, of a ball that it can just kick, m."""
        self.tick = 0
        """Ticks since the situation started."""
        space = self._space = pymunk.Space()
        space.iterations = ITERATIONS
        self._ball = _add_ball(space, field, ball)._body
        bodies = [_add_robot(space, walk, pose) for pose in poses]
        _add_posts(space, field)
        self._bodies = [body._body for body, _ in bodies]
        self.robots = tuple(
            Robot(walk, control._body, field.max_x, field.max_y) for _, control in bodies
        )
        """The robots in the order of their poses."""
        self.kicked_by: Robot | None = None
        """Who kicked the ball last."""
        self.update()

    def advance(self) -> None:
        """Simulate one tick and update positions and velocities."""
        step, space = chipmunk.step, self._space._space
        for _ in range(STEPS_PER_TICK):
            step(space, PHYSICS_STEP)
        self.tick += 1
        self.update()

    def update(self) -> None:
        """Copy positions, headings and the ball's velocity from the physics."""
        place, velocity = chipmunk.position(self._ball), chipmunk.velocity(self._ball)
        self.ball_x, self.ball_y = place.x, place.y
        self.ball_vx, self.ball_vy = velocity.x, velocity.y
        for robot, body in zip(self.robots, self._bodies, strict=True):
            place = chipmunk.position(body)
            robot.x, robot.y = place.x, place.y
            angle = chipmunk.angle(body)
            robot.heading = angle if -pi <= angle <= pi else wrap(angle % (2.0 * pi))

    def kick(
        self, direction: float, speed: float, rng: np.random.Generator, by: Robot | None = None
    ) -> None:
        """Give the ball a velocity.

        Args:
            direction: Where it goes, rad.
            speed: Mean speed, m/s; the actual speed varies by `KICK_SPREAD`.
            rng: Draws the speed.
            by: The kicking robot; None if it is not in this world.
        """
        self.kicked_by = by
        speed *= rng.uniform(1.0 - KICK_SPREAD, 1.0 + KICK_SPREAD)
        self.ball_vx, self.ball_vy = speed * cos(direction), speed * sin(direction)
        chipmunk.set_velocity(self._ball, (self.ball_vx, self.ball_vy))


def _add_ball(space: pymunk.Space, field: Field, position: tuple[float, float]) -> pymunk.Body:
    moment = pymunk.moment_for_circle(field.ball_mass, 0.0, field.ball_radius)
    body = pymunk.Body(field.ball_mass, moment)
    body.position = position
    shape = pymunk.Circle(body, field.ball_radius)
    shape.elasticity, shape.friction = 0.4, 0.4
    force = field.ball_mass * field.ball_deceleration
    space.add(body, shape, *_drag(space.static_body, body, force, field.ball_spin_torque))
    return body


def _add_robot(space: pymunk.Space, walk: Walk, pose: Pose) -> tuple[pymunk.Body, pymunk.Body]:
    x, y, heading = pose
    body = pymunk.Body(walk.mass, pymunk.moment_for_circle(walk.mass, 0.0, walk.radius))
    body.position, body.angle = (x, y), heading
    shape = pymunk.Circle(body, walk.radius)
    shape.elasticity, shape.friction = 0.1, 0.4
    control = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
    space.add(control, body, shape, *_drag(control, body, walk.grip, walk.turning_grip))
    return body, control


def _add_posts(space: pymunk.Space, field: Field) -> None:
    y = field.half_goal + field.post_radius
    for post in ((field.own_goal_x, -y), (field.own_goal_x, y)):
        shape = pymunk.Circle(space.static_body, field.post_radius, post)
        shape.elasticity, shape.friction = 0.4, 0.4
        space.add(shape)


def _drag(
    leader: pymunk.Body, body: pymunk.Body, force: float, torque: float
) -> tuple[pymunk.Constraint, pymunk.Constraint]:
    """Joints that bring a body to the velocity of its leader with limited force.

    They ignore where the leader is (`max_bias` 0); after a static body this is dry friction.
    """
    linear = pymunk.PivotJoint(leader, body, (0.0, 0.0), (0.0, 0.0))
    angular = pymunk.GearJoint(leader, body, 0.0, 1.0)
    linear.max_bias = angular.max_bias = 0.0
    linear.max_force, angular.max_force = force, torque
    return linear, angular
