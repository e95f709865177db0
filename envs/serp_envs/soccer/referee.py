"""The part of the rules common to all scenarios: a ball over a line, a secured ball."""

from __future__ import annotations

from math import hypot
from typing import Final

from serp_envs.soccer.physics.periods import TICK, ticks
from serp_envs.soccer.physics.world import World

SECURE_MARGIN: Final = 0.15
"""A ball is secured with the defender nearer than contact + this, m …"""
SECURE_CLEAR: Final = 0.50
"""… the attacker farther than this from it, m …"""
SECURE_LEAD: Final = 0.25
"""… and farther than the defender by this, m …"""
SECURE_SPEED: Final = 0.5
"""… the ball slower than this, m/s …"""
SECURE_HELD: Final = ticks(1.0)
"""… and all that for so long."""


class Referee:
    """Judges a world whose first robot defends and whose second robot attacks."""

    __slots__ = ("_last_x", "_last_y", "_secure", "_world", "d_ob", "d_rb")

    def __init__(self, world: World) -> None:
        self._world = world
        self._last_x, self._last_y = world.ball_x, world.ball_y
        self._secure = 0
        self.d_rb = self.d_ob = 0.0
        """Distance of the defender, of the attacker from the ball at the last check, m."""

    @property
    def secure_timer(self) -> float:
        """For how long the ball has been as good as secured, s; 1 s secures it."""
        return TICK * self._secure

    def check(self) -> str | None:
        """Check the world after a tick.

        Returns:
            "goal", "out", "secured", in this order of precedence, or None.
        """
        world = self._world
        field, x, y = world.field, world.ball_x, world.ball_y
        line = world.goal_x - field.ball_radius
        if x < line:
            x0, y0 = self._last_x, self._last_y
            crossed = y0 + (y - y0) * (line - x0) / (x - x0) if x < x0 else y
            return "goal" if abs(crossed) < field.half_goal else "out"
        if x > -line or abs(y) > 0.5 * field.width + field.ball_radius:
            return "out"
        self._last_x, self._last_y = x, y
        defender, attacker = world.robots[0], world.robots[1]
        self.d_rb = d_rb = hypot(defender.x - x, defender.y - y)
        self.d_ob = d_ob = hypot(attacker.x - x, attacker.y - y)
        if (
            d_rb < world.contact + SECURE_MARGIN
            and d_ob > SECURE_CLEAR
            and d_ob > d_rb + SECURE_LEAD
            and hypot(world.ball_vx, world.ball_vy) < SECURE_SPEED
            and defender.down_until <= world.tick
        ):
            self._secure += 1
            return "secured" if self._secure >= SECURE_HELD else None
        self._secure = 0
        return None
