"""The interface of a scenario: start, opponents, actions, rules, observation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp_envs.soccer.fields import Field
from serp_envs.soccer.opponents.attacker import Attacker
from serp_envs.soccer.physics.geometry import goal_coverage
from serp_envs.soccer.physics.periods import ticks
from serp_envs.soccer.physics.world import World
from serp_envs.soccer.referee import Referee


@dataclass(frozen=True, slots=True)
class Ruling:
    """How an episode ended."""

    outcome: str
    """One word for it."""
    reward: float
    """Reward of the learning robot."""
    dead_time: float
    """Until the game goes on, s."""
    truncated: bool = False
    """Whether the episode was truncated."""


PLAYING = "playing"
"""The outcome of an episode that has none yet."""
GOAL: Final = Ruling("goal", -10.0, dead_time=15.0)
SECURED: Final = Ruling("secured", 10.0, dead_time=5.0)
TIMEOUT: Final = Ruling("timeout", -2.0, dead_time=5.0, truncated=True)
LIMIT: Final = ticks(30.0)
"""An episode longer than this is cut off."""
COVERAGE_WEIGHT: Final = 0.10
"""Cost of a decision that ends with the whole goal open. Covering is not rewarded: the robot would
learn to stay in front of the goal until the time is up."""


class Scenario(ABC):
    """A repeated situation of a game; `SoccerEnv` makes it an environment.

    The environment calls `start`, then for each tick of a decision `command` and, after the
    physics, `judge`, and at the end of the decision `reward`, `observe` and `facts`.
    """

    actions: ClassVar[tuple[str, ...]]
    """The actions in words; their numbers are their places."""
    unsafe: ClassVar[frozenset[int]] = frozenset()
    """Actions that can damage a robot."""
    teams: ClassVar[tuple[str, ...]]
    """A word for each robot of the world; the first is the one that learns."""
    out: ClassVar[Ruling]
    """The ruling for a ball out of the field."""

    def __init__(self, field: Field) -> None:
        self.field = field
        self.world: World
        """The world of the running episode, from `start` on."""
        self.attacker: Attacker
        """The policy of the attacker, from `start` on."""
        self.referee: Referee
        """The referee, from `start` on."""
        self.hits = 0
        """Damaging hits by the learning robot in this episode."""
        self.started = 0
        """The tick at which the episode began."""
        self._seen = {ruling.outcome: ruling for ruling in (GOAL, SECURED, self.out)}
        self._names = [
            (f"{team}_x", f"{team}_y", f"{team}_heading", f"{team}_down") for team in self.teams
        ]

    @property
    @abstractmethod
    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """The space of `observe`."""

    @abstractmethod
    def start(self, rng: np.random.Generator) -> None:
        """Set `world` to a new one in which an episode begins. Its `tick` may be above 0."""

    @abstractmethod
    def command(self, action: int, rng: np.random.Generator) -> None:
        """Command every robot for a tick; the learning one does `action`."""

    @abstractmethod
    def ruling(self) -> Ruling | None:
        """Return the scenario's own ruling after a tick, if there is one."""

    def judge(self) -> Ruling | None:
        """Return the first after a tick of goal, out, secured, its own ruling and timeout."""
        seen = self.referee.check()
        ruling = self.ruling() if seen is None else self._seen[seen]
        if ruling is None and self.world.tick - self.started >= LIMIT:
            return TIMEOUT
        return ruling

    @abstractmethod
    def reward(self) -> float:
        """Return the reward of the finished decision, without that of a ruling."""

    @abstractmethod
    def observe(self) -> NDArray[np.float32]:
        """Return a new observation."""

    def cost_of_open_goal(self) -> float:
        """Return the reward, at most 0, for the share of the goal that the first robot covers."""
        world, half_goal = self.world, self.field.half_goal
        robot, x, y = world.robots[0], world.ball_x, world.ball_y
        covered = goal_coverage(x, y, robot.x, robot.y, world.contact, world.goal_x, half_goal)
        return COVERAGE_WEIGHT * (covered - 1.0)

    def facts(self) -> dict[str, Any]:
        """Return the situation for `info`: flat, so that vectors of them stack.

        Returns:
            Metres, radians, seconds: `ball_x`, `ball_y`, `ball_vx`, `ball_vy` and of each robot,
            after its word in `teams`, `…_x`, `…_y`, `…_heading` and whether it is `…_down`;
            `wind_up` of the attacker and `secure_timer`.
        """
        world = self.world
        facts: dict[str, Any] = {
            "ball_x": world.ball_x,
            "ball_y": world.ball_y,
            "ball_vx": world.ball_vx,
            "ball_vy": world.ball_vy,
        }
        tick = world.tick
        for robot, (x, y, heading, down) in zip(world.robots, self._names, strict=True):
            facts[x] = robot.x
            facts[y] = robot.y
            facts[heading] = robot.heading
            facts[down] = robot.down_until > tick
        facts["wind_up"] = self.attacker.wind_up
        facts["secure_timer"] = self.referee.secure_timer
        return facts
