"""A walking robot: where it is, whether it stands, and the controller that walks it."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin, sqrt
from typing import Final

from serp_envs.soccer.physics import chipmunk
from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import TICK


@dataclass(frozen=True, slots=True)
class Walk:
    """The limits of a walk; those of the three directions span an ellipse."""

    forward: float = 0.25
    """m/s."""
    back: float = 0.15
    """m/s."""
    sideways: float = 0.20
    """m/s."""
    turn: float = 1.66
    """rad/s."""
    radius: float = 0.15
    """Of the body, m."""
    mass: float = 5.4
    """kg."""
    grip: float = 8.1
    """Largest force between feet and carpet, N."""
    turning_grip: float = 1.0
    """Largest torque between feet and carpet, N·m."""


NAO: Final = Walk()
"""The robot of the Standard Platform League."""

APPROACH_GAIN: Final = 3.0
"""Wanted speed per distance to the target, 1/s: a robot slows down over its last 8 cm."""
TURN_GAIN: Final = 1.0 / TICK
"""Wanted turn rate per heading error, 1/s: what is left is turned within one tick."""


class Robot:
    """One robot in a `World`; its pose is as of the last `World.update`.

    The controller only sets the velocity of a control body; joints of limited force drag the robot
    after it, so that a robot that runs into something slips instead of passing through.
    """

    __slots__ = (
        "_control",
        "_max_x",
        "_max_y",
        "down_until",
        "heading",
        "hit_ready",
        "kick_ready",
        "walk",
        "x",
        "y",
    )

    def __init__(self, walk: Walk, control: chipmunk.Handle, max_x: float, max_y: float) -> None:
        """Create a robot whose bodies are in the physics already.

        Targets beyond ± `max_x` and ± `max_y` are taken to be there.
        """
        self.walk = walk
        self._control = control
        self._max_x = max_x
        self._max_y = max_y
        self.x = self.y = self.heading = 0.0
        self.down_until = 0
        """The tick at which it stands again."""
        self.kick_ready = 0
        """The tick from which it may kick again."""
        self.hit_ready = 0
        """The tick from which a charge may do damage again."""

    def stop(self) -> None:
        """Stand still."""
        self._drive(0.0, 0.0, 0.0)

    def _drive(self, vx: float, vy: float, turn: float) -> None:
        chipmunk.set_velocity(self._control, (vx, vy))
        chipmunk.set_turn(self._control, turn)

    def go_to(self, x: float, y: float, face_x: float, face_y: float, pace: float = 1.0) -> None:
        """Walk straight towards (x, y) with the face towards (face_x, face_y).

        Args:
            x: Target; beyond the carpet it means the carpet's edge.
            y: See `x`.
            face_x: What to turn to.
            face_y: See `face_x`.
            pace: Factor on the limits of the walk.
        """
        walk = self.walk
        limit = self._max_x
        x = limit if x > limit else -limit if x < -limit else x
        limit = self._max_y
        y = limit if y > limit else -limit if y < -limit else y
        dx, dy = x - self.x, y - self.y
        heading = self.heading
        c, s = cos(heading), sin(heading)
        ahead = APPROACH_GAIN * (c * dx + s * dy)
        left = APPROACH_GAIN * (c * dy - s * dx)
        a = ahead / ((walk.forward if ahead > 0.0 else walk.back) * pace)
        b = left / (walk.sideways * pace)
        excess = a * a + b * b
        if excess > 1.0:
            shrink = 1.0 / sqrt(excess)
            ahead *= shrink
            left *= shrink
        turn = TURN_GAIN * wrap(atan2(face_y - self.y, face_x - self.x) - heading)
        limit = walk.turn
        turn = limit if turn > limit else -limit if turn < -limit else turn
        self._drive(c * ahead - s * left, s * ahead + c * left, turn)
