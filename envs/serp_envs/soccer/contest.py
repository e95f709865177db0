"""The rules of a contest for the ball: when it ends, who won it, what each decision is worth."""

from __future__ import annotations

from math import hypot
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp_envs.soccer import actions
from serp_envs.soccer.approach import CONTEST_RADIUS, approach
from serp_envs.soccer.attacker import Attacker
from serp_envs.soccer.fields import Field
from serp_envs.soccer.geometry import goal_coverage
from serp_envs.soccer.observation import SPACE, observe
from serp_envs.soccer.scenario import Ruling, Scenario
from serp_envs.soccer.timing import TICK, ticks

GOAL: Final = Ruling("goal", -10.0, dead_time=15.0)
SECURED: Final = Ruling("secured", 10.0, dead_time=5.0)
EXIT_NEARER: Final = Ruling("exit-nearer", 2.0, dead_time=0.0)
EXIT_FARTHER: Final = Ruling("exit-farther", -4.0, dead_time=0.0)
OUT: Final = Ruling("out", 0.0, dead_time=10.0)
TIMEOUT: Final = Ruling("timeout", -2.0, dead_time=5.0, truncated=True)

LIMIT: Final = ticks(30.0)
"""A contest longer than this is cut off."""
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
EXIT_SLACK: Final = 0.02
"""A robot leaves the contest this far outside its radius, m: it does not flicker in and out."""
EXIT_SPEED: Final = 0.25
"""It does not end while the ball is faster than this, m/s: a shot may be on its way."""
NEARER_WEIGHT: Final = 0.05
"""Reward of a decision that ends `CONTEST_RADIUS` nearer to the ball than the attacker."""
COVERAGE_WEIGHT: Final = 0.10
"""Cost of a decision that ends with the whole goal open. Covering never earns anything: that
would teach to camp in front of the goal until the time is up."""


class Contest(Scenario):
    """A defender and an attacker within 70 cm of the ball fight for it (paper, section 4.2)."""

    actions = (
        "cover-goal",
        "side-advance left",
        "side-advance right",
        "frontal-contrast",
        "charge-opponent",
    )
    unsafe = frozenset({4})
    teams = ("defender", "attacker")

    def __init__(self, field: Field) -> None:
        """The scenario on that field, before its first `start`."""
        super().__init__(field)
        self.attacker: Attacker
        """Who plays the attacker, from `start` on."""
        self._started = 0
        self._secure = 0
        self._last_ball = (0.0, 0.0)

    @property
    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """16 numbers, see `serp_envs.soccer.observation`."""
        return SPACE

    @property
    def secure_timer(self) -> float:
        """For how long the ball has been as good as secured, s; 1 s secures it."""
        return TICK * self._secure

    def start(self, rng: np.random.Generator) -> None:
        """Play approaches until both robots are within the contest's radius of the ball."""
        self.world, self.attacker = approach(self.field, rng)
        self._started = self.world.tick
        self._secure = 0
        self.hits = 0
        self._last_ball = (self.world.ball_x, self.world.ball_y)

    def command(self, action: int, rng: np.random.Generator) -> None:
        """Command both robots for a tick, the defender first."""
        world = self.world
        defender, opponent = world.robots
        self._last_ball = (world.ball_x, world.ball_y)
        if defender.down_until > world.tick:
            defender.stop()
        elif action == 0:
            actions.cover_goal(world, defender)
        elif action == 1:
            actions.side_advance(world, defender, 1.0, rng)
        elif action == 2:
            actions.side_advance(world, defender, -1.0, rng)
        elif action == 3:
            actions.frontal_contrast(world, defender)
        else:
            self.hits += actions.charge(world, defender, opponent, rng)
        self.attacker.act(world, defender, rng)

    def judge(self) -> Ruling | None:
        """Goal, out, secured, exit, time, in this order."""
        world, field = self.world, self.field
        defender, attacker = world.robots
        x, y = world.ball_x, world.ball_y
        if x < world.goal_x - field.ball_radius:
            return GOAL if self._between_posts() else OUT
        if x > field.ball_radius - world.goal_x or abs(y) > 0.5 * field.width + (field.ball_radius):
            return OUT
        d_rb, d_ob = hypot(defender.x - x, defender.y - y), hypot(attacker.x - x, attacker.y - y)
        speed = hypot(world.ball_vx, world.ball_vy)
        if (
            d_rb < world.contact + SECURE_MARGIN
            and d_ob > SECURE_CLEAR
            and d_ob > d_rb + SECURE_LEAD
            and speed < SECURE_SPEED
            and defender.down_until <= world.tick
        ):
            self._secure += 1
            if self._secure >= SECURE_HELD:
                return SECURED
        else:
            self._secure = 0
        if speed < EXIT_SPEED and max(d_rb, d_ob) > CONTEST_RADIUS + EXIT_SLACK:
            return EXIT_NEARER if d_rb < d_ob else EXIT_FARTHER
        return TIMEOUT if world.tick - self._started >= LIMIT else None

    def _between_posts(self) -> bool:
        """Whether the ball, now behind the goal line, crossed it in the goal."""
        x0, y0 = self._last_ball
        x1, y1 = self.world.ball_x, self.world.ball_y
        line = self.world.goal_x - self.field.ball_radius
        y = y0 + (y1 - y0) * (line - x0) / (x1 - x0) if x1 < x0 else y1
        return abs(y) < self.field.half_goal

    def coverage(self) -> float:
        """The share of the goal, seen from the ball, that the defender covers, 0 to 1."""
        world, field = self.world, self.field
        defender = world.robots[0]
        return goal_coverage(
            world.ball_x,
            world.ball_y,
            defender.x,
            defender.y,
            world.contact,
            world.goal_x,
            field.half_goal,
        )

    def reward(self) -> float:
        """For being nearer to the ball than the attacker and for covering the goal."""
        world = self.world
        defender, attacker = world.robots
        x, y = world.ball_x, world.ball_y
        d_rb, d_ob = hypot(defender.x - x, defender.y - y), hypot(attacker.x - x, attacker.y - y)
        lead = (d_ob - d_rb) / CONTEST_RADIUS
        lead = 1.0 if lead > 1.0 else -1.0 if lead < -1.0 else lead
        return NEARER_WEIGHT * lead + COVERAGE_WEIGHT * (self.coverage() - 1.0)

    def observe(self) -> NDArray[np.float32]:
        """See `serp_envs.soccer.observation`."""
        return observe(self.world, self.attacker.wind_up, self.secure_timer)

    def facts(self) -> dict[str, Any]:
        """Poses, ball, wind-up, who is down, secure timer: flat, so that vectors of them stack."""
        world = self.world
        defender, attacker = world.robots
        tick = world.tick
        return {
            "ball_x": world.ball_x,
            "ball_y": world.ball_y,
            "ball_vx": world.ball_vx,
            "ball_vy": world.ball_vy,
            "defender_x": defender.x,
            "defender_y": defender.y,
            "defender_heading": defender.heading,
            "defender_down": defender.down_until > tick,
            "attacker_x": attacker.x,
            "attacker_y": attacker.y,
            "attacker_heading": attacker.heading,
            "attacker_down": attacker.down_until > tick,
            "wind_up": self.attacker.wind_up,
            "secure_timer": self.secure_timer,
        }
