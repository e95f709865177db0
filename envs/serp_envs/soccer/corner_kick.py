"""The rules of a corner kick: actions, end, reward and observation of the defender."""

from __future__ import annotations

from math import atan2, cos, hypot, radians, sin
from typing import Any, Final, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp_envs.soccer.actions import ball_in_front, charge
from serp_envs.soccer.fields import Field
from serp_envs.soccer.observation import FASTEST
from serp_envs.soccer.opponents.attacker import WIND_UP
from serp_envs.soccer.opponents.corner_attack import CornerAttack
from serp_envs.soccer.physics.geometry import wrap
from serp_envs.soccer.physics.periods import ticks
from serp_envs.soccer.physics.robot import Robot
from serp_envs.soccer.physics.rolling import meeting
from serp_envs.soccer.referee import Referee
from serp_envs.soccer.scenario import Ruling, Scenario

CLEARED: Final = Ruling("cleared", 10.0, dead_time=5.0)
CLEARED_AT: Final = 2.8
"""A ball that the defender kicked last is cleared this far from the goal's middle, m."""
POST_DEPTH: Final = 0.35
"""A robot that marks a post stands this far before the goal line, m …"""
POST_SHARE: Final = 0.6
"""… at this share of half the goal's width."""
MARK_GAP: Final = 0.45
"""A robot that marks the attacker stands this far from it, towards the goal, m."""
CLEAR_TURN: Final = radians(60.0)
"""A clearance leaves within ± this of the line from the robot to the ball, rad …"""
CLEAR_SIGMA: Final = radians(20.0)
"""… and misses its direction by this standard deviation, rad …"""
CLEAR_SPEED: Final = 1.1
"""… at this speed on average, m/s."""
CLEAR_COOLDOWN: Final = ticks(0.8)
UNIT: Final = 2.0
"""The unit of places in the observation, m."""

_SIZE: Final = 17
_LOW: Final = np.full(_SIZE, -6.0, dtype=np.float32)
_HIGH: Final = np.full(_SIZE, 6.0, dtype=np.float32)
_LOW[6:8], _HIGH[6:8] = -FASTEST, FASTEST
_LOW[8:12], _HIGH[8:12] = -1.0, 1.0
_LOW[12:], _HIGH[12:] = 0.0, 1.0


class CornerKick(Scenario):
    """A defender against a corner: a robot kicks the ball in and an attacker runs to meet it."""

    actions = (
        "mark-near-post",
        "mark-far-post",
        "mark-attacker",
        "intercept",
        "clear",
        "charge-opponent",
    )
    unsafe = frozenset({5})
    teams = ("defender", "attacker", "kicker")
    out = Ruling("out", -2.0, dead_time=10.0)

    def __init__(self, field: Field) -> None:
        super().__init__(field)
        self.attack: CornerAttack
        """The policy of the other two robots, from `start` on."""

    @property
    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """17 numbers, see `observe`."""
        space = spaces.Box(_LOW, _HIGH, dtype=np.float32)
        return cast(spaces.Space[NDArray[np.float32]], space)

    def start(self, rng: np.random.Generator) -> None:
        """Place all robots for a corner on either side."""
        self.attack = CornerAttack(self.field, rng)
        self.world, self.attacker = self.attack.world, self.attack.attacker
        self.referee = Referee(self.world)
        self.hits = 0

    def command(self, action: int, rng: np.random.Generator) -> None:
        """Command the robots for a tick, the defender first."""
        world = self.world
        defender, opponent = world.robots[0], world.robots[1]
        if defender.down_until > world.tick:
            defender.stop()
        elif action <= 1:
            self._mark_post(defender, 1.0 if action == 0 else -1.0)
        elif action == 2:
            self._mark(defender, opponent)
        elif action == 3:
            x, y, _ = meeting(world, defender)
            defender.go_to(x, y, world.ball_x, world.ball_y)
        elif action == 4:
            self._clear(defender, rng)
        else:
            self.hits += charge(world, defender, opponent, rng)
        self.attack.act(rng)

    def _mark_post(self, robot: Robot, end: float) -> None:
        """Stand before the post near the corner (+1) or before the other (−1)."""
        world = self.world
        y = end * self.attack.side * POST_SHARE * self.field.half_goal
        robot.go_to(world.goal_x + POST_DEPTH, y, world.ball_x, world.ball_y)

    def _mark(self, robot: Robot, opponent: Robot) -> None:
        """Stand between the attacker and the goal's middle."""
        world = self.world
        dx, dy = world.goal_x - opponent.x, -opponent.y
        share = MARK_GAP / max(hypot(dx, dy), MARK_GAP)
        robot.go_to(opponent.x + share * dx, opponent.y + share * dy, world.ball_x, world.ball_y)

    def _clear(self, robot: Robot, rng: np.random.Generator) -> None:
        """Walk to the ball and kick it away from the goal."""
        world = self.world
        x, y = world.ball_x, world.ball_y
        robot.go_to(x, y, x, y)
        bearing = ball_in_front(world, robot)
        if bearing is None:
            return
        turn = wrap(atan2(y, x - world.goal_x) - bearing)
        turn = max(-CLEAR_TURN, min(CLEAR_TURN, turn))
        world.kick(rng.normal(bearing + turn, CLEAR_SIGMA), CLEAR_SPEED, rng, robot)
        robot.kick_ready = world.tick + CLEAR_COOLDOWN

    def ruling(self) -> Ruling | None:
        """Return that the ball is cleared, once the defender kicked it far away."""
        world = self.world
        away = hypot(world.ball_x - world.goal_x, world.ball_y) > CLEARED_AT
        return CLEARED if away and world.kicked_by is world.robots[0] else None

    def reward(self) -> float:
        """Return 0 before the kick, then the cost of an open goal."""
        return self.cost_of_open_goal() if self.attack.kicked else 0.0

    def observe(self) -> NDArray[np.float32]:
        """Return the observation, mirrored so that every corner is on the defender's left.

        Returns:
            float32 of shape `(17,)`: x, y of defender, attacker and ball from the goal's middle in
            units of 2 m; the ball's velocity, m/s; cosine and sine of the defender's and of the
            attacker's heading; 1 once the corner is taken; the wind-up from 0 to 1; 1 while the
            attacker is down, 1 while the defender is down; the secure timer, 0 to 1 s. y points to
            the side of the corner.
        """
        world, side = self.world, self.attack.side
        defender, attacker = world.robots[0], world.robots[1]
        goal_x, across = world.goal_x, side / UNIT
        tick = world.tick
        return np.array(
            (
                (defender.x - goal_x) / UNIT,
                across * defender.y,
                (attacker.x - goal_x) / UNIT,
                across * attacker.y,
                (world.ball_x - goal_x) / UNIT,
                across * world.ball_y,
                max(-FASTEST, min(FASTEST, world.ball_vx)),
                max(-FASTEST, min(FASTEST, side * world.ball_vy)),
                cos(defender.heading),
                side * sin(defender.heading),
                cos(attacker.heading),
                side * sin(attacker.heading),
                float(self.attack.kicked),
                self.attacker.wind_up / WIND_UP,
                float(attacker.down_until > tick),
                float(defender.down_until > tick),
                self.referee.secure_timer,
            ),
            dtype=np.float32,
        )

    def facts(self) -> dict[str, Any]:
        """Return the facts of `Scenario`, with corner and kick."""
        facts = super().facts()
        facts["corner"] = self.attack.side
        facts["kicked"] = self.attack.kicked
        return facts
