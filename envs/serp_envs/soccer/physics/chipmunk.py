"""Functions of Chipmunk, the C library under pymunk, for what is done in every tick.

The checks and conversions of pymunk's documented interface take as long as the physics; results are
equal to the last bit. pymunk 5 to 7 have these functions.
"""

from __future__ import annotations

from typing import Any, Final

from pymunk._chipmunk_cffi import lib

Handle = Any
"""A body or space of C; it lives as long as pymunk's space."""

step: Final[Any] = lib.cpSpaceStep
position: Final[Any] = lib.cpBodyGetPosition
velocity: Final[Any] = lib.cpBodyGetVelocity
angle: Final[Any] = lib.cpBodyGetAngle
set_velocity: Final[Any] = lib.cpBodySetVelocity
set_turn: Final[Any] = lib.cpBodySetAngularVelocity
