"""Two interfaces to pymunk for the inner loop, with equal results to the last bit.

`Portable` uses pymunk's documented interface. Its checks and conversions take longer than the
physics, so `Native` calls the C library under pymunk directly. `ENGINE` is the faster one that the
installed pymunk supports.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi
from typing import Any, Final, Protocol

import pymunk

from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import PHYSICS_STEP, STEPS_PER_TICK

_step: Any
_place: Any
_velocity: Any
_angle: Any
_set_velocity: Any
_set_turn: Any
try:
    from pymunk._chipmunk_cffi import lib

    _step = lib.cpSpaceStep
    _place, _velocity, _angle = lib.cpBodyGetPosition, lib.cpBodyGetVelocity, lib.cpBodyGetAngle
    _set_velocity, _set_turn = lib.cpBodySetVelocity, lib.cpBodySetAngularVelocity
except (ImportError, AttributeError):  # a differently built pymunk; 5 to 7 have them all
    _step = None

NATIVE: Final = (
    _step is not None and hasattr(pymunk.Space(), "_space") and hasattr(pymunk.Body(), "_body")
)
"""Whether this pymunk has what `Native` needs."""


Drive = Callable[[float, float, float], None]
"""Sets a velocity: x, y, turn."""

_STEPS: Final = range(STEPS_PER_TICK)
_TURN: Final = 2.0 * pi


class Placed(Protocol):
    """An object with a pose."""

    x: float
    """m."""
    y: float
    """m."""
    heading: float
    """In [−π, π], rad."""


class Engine(Protocol):
    """Steps a space and moves numbers in and out of it."""

    def __init__(
        self,
        space: pymunk.Space,
        ball: pymunk.Body,
        robots: Sequence[tuple[pymunk.Body, pymunk.Body]],
    ) -> None:
        """Create an engine of a space.

        Args:
            space: The complete space.
            ball: The ball's body.
            robots: For each robot its body and the control body that drags it.
        """

    def advance(self) -> None:
        """Let one tick pass."""

    def ball(self) -> tuple[float, float, float, float]:
        """Return the ball's x and y, m, and its velocity in x and y, m/s."""

    def place(self, robots: Sequence[Placed]) -> None:
        """Write the poses of the bodies to the robots, in the order of the bodies."""

    def driver(self, number: int) -> Drive:
        """Return a function that sets the velocity of a robot's control body."""

    def kick(self, vx: float, vy: float) -> None:
        """Set the ball's velocity, m/s."""


class Portable:
    """An engine on pymunk's documented interface."""

    __slots__ = ("_ball", "_robots", "_space")

    def __init__(
        self,
        space: pymunk.Space,
        ball: pymunk.Body,
        robots: Sequence[tuple[pymunk.Body, pymunk.Body]],
    ) -> None:
        """See `Engine`."""
        self._space = space
        self._ball = ball
        self._robots = tuple(robots)

    def advance(self) -> None:
        """See `Engine`."""
        step = self._space.step
        for _ in range(STEPS_PER_TICK):
            step(PHYSICS_STEP)

    def ball(self) -> tuple[float, float, float, float]:
        """See `Engine`."""
        return (*self._ball.position, *self._ball.velocity)

    def place(self, robots: Sequence[Placed]) -> None:
        """See `Engine`."""
        for robot, (body, _) in zip(robots, self._robots, strict=True):
            robot.x, robot.y = body.position
            angle = body.angle
            robot.heading = angle if -pi <= angle <= pi else wrap(angle % _TURN)

    def driver(self, number: int) -> Drive:
        """See `Engine`."""
        control = self._robots[number][1]

        def drive(vx: float, vy: float, turn: float) -> None:
            control.velocity = (vx, vy)
            control.angular_velocity = turn

        return drive

    def kick(self, vx: float, vy: float) -> None:
        """See `Engine`."""
        self._ball.velocity = (vx, vy)


class Native:
    """An engine on the functions of Chipmunk, the C library under pymunk."""

    __slots__ = ("_alive", "_ball", "_robots", "_space")

    def __init__(
        self,
        space: pymunk.Space,
        ball: pymunk.Body,
        robots: Sequence[tuple[pymunk.Body, pymunk.Body]],
    ) -> None:
        """See `Engine`."""
        # Handles own what they point to, but joints and shapes live with pymunk's space only.
        self._alive = space
        self._space = space._space
        self._ball = ball._body
        self._robots = tuple((body._body, control._body) for body, control in robots)

    def advance(self) -> None:
        """See `Engine`."""
        step, space, seconds = _step, self._space, PHYSICS_STEP
        for _ in _STEPS:
            step(space, seconds)

    def ball(self) -> tuple[float, float, float, float]:
        """See `Engine`."""
        ball = self._ball
        position, velocity = _place(ball), _velocity(ball)
        return position.x, position.y, velocity.x, velocity.y

    def place(self, robots: Sequence[Placed]) -> None:
        """See `Engine`."""
        place, angle_of = _place, _angle
        for robot, (body, _) in zip(robots, self._robots):  # noqa: B905, it costs
            at = place(body)
            robot.x, robot.y = at.x, at.y
            angle = angle_of(body)
            robot.heading = angle if -pi <= angle <= pi else wrap(angle % _TURN)

    def driver(self, number: int) -> Drive:
        """See `Engine`."""
        control = self._robots[number][1]
        set_velocity, set_turn = _set_velocity, _set_turn

        def drive(vx: float, vy: float, turn: float) -> None:
            set_velocity(control, (vx, vy))
            set_turn(control, turn)

        return drive

    def kick(self, vx: float, vy: float) -> None:
        """See `Engine`."""
        _set_velocity(self._ball, (vx, vy))


ENGINE: type[Engine] = Native if NATIVE else Portable
"""The engine of every new world."""
