"""The rules of a contest for the ball: when it ends, who won it, what each decision is worth."""

from __future__ import annotations

from math import hypot
from typing import Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp_envs.soccer import actions
from serp_envs.soccer.observation import SPACE, observe
from serp_envs.soccer.opponents.approach import CONTEST_RADIUS, approach
from serp_envs.soccer.referee import Referee
from serp_envs.soccer.scenario import Ruling, Scenario

EXIT_NEARER: Final = Ruling("exit-nearer", 2.0, dead_time=0.0)
EXIT_FARTHER: Final = Ruling("exit-farther", -4.0, dead_time=0.0)
EXIT_SLACK: Final = 0.02
"""A robot leaves the contest this far outside its radius, m: it does not flicker in and out."""
EXIT_SPEED: Final = 0.25
"""It does not end while the ball is faster than this, m/s: a shot may be on its way."""
NEARER_WEIGHT: Final = 0.05
"""Reward of a decision that ends `CONTEST_RADIUS` nearer to the ball than the attacker."""


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
    out = Ruling("out", 0.0, dead_time=10.0)

    @property
    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """16 numbers, see `serp_envs.soccer.observation`."""
        return SPACE

    def start(self, rng: np.random.Generator) -> None:
        """Play approaches until both robots are within the contest's radius of the ball."""
        self.world, self.attacker = approach(self.field, rng)
        self.referee = Referee(self.world)
        self.started = self.world.tick
        self.hits = 0

    def command(self, action: int, rng: np.random.Generator) -> None:
        """Command both robots for a tick, the defender first."""
        world = self.world
        defender, opponent = world.robots
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

    def ruling(self) -> Ruling | None:
        """Return an exit, once a robot has left and the ball is slow."""
        world = self.world
        if hypot(world.ball_vx, world.ball_vy) < EXIT_SPEED:
            d_rb, d_ob = self.referee.d_rb, self.referee.d_ob
            if d_rb > CONTEST_RADIUS + EXIT_SLACK or d_ob > CONTEST_RADIUS + EXIT_SLACK:
                return EXIT_NEARER if d_rb < d_ob else EXIT_FARTHER
        return None

    def reward(self) -> float:
        """Return the reward for the lead over the attacker and for covering the goal."""
        world = self.world
        defender, attacker = world.robots
        x, y = world.ball_x, world.ball_y
        d_rb, d_ob = hypot(defender.x - x, defender.y - y), hypot(attacker.x - x, attacker.y - y)
        lead = (d_ob - d_rb) / CONTEST_RADIUS
        lead = 1.0 if lead > 1.0 else -1.0 if lead < -1.0 else lead
        return NEARER_WEIGHT * lead + self.cost_of_open_goal()

    def observe(self) -> NDArray[np.float32]:
        """Return 16 numbers, see `serp_envs.soccer.observation`."""
        return observe(self.world, self.attacker.wind_up, self.referee.secure_timer)
