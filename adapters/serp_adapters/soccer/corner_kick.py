"""The corner-kick task: its environment, its grounding in distances, times and angles."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp_adapters.domains import domain_file
from serp_adapters.soccer.shared import CONTACT, PROTOCOL, Numbers, open_share
from serp_envs.soccer.corner_kick import MARK_GAP, UNIT
from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.opponents.attacker import ALIGNED_SHOT, STAND_MARGIN, WIND_UP
from serp_envs.soccer.physics.periods import DECISION
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.rolling import STILL, TIME_STEP, way
from serp_envs.soccer.physics.world import REACH

HORIZON: Final = 6.0
"""Longest time that a kicked ball rolls, s."""
ROUND: Final = (CONTACT + STAND_MARGIN) / NAO.sideways
"""Time that the opponent needs to walk round the ball, facing it, s per rad."""

_AHEAD: Final = np.arange(0.0, HORIZON + 0.5 * TIME_STEP, TIME_STEP)


def until_met(x: Numbers, y: Numbers, vx: Numbers, vy: Numbers, gap: float) -> Numbers:
    """Return the seconds until a robot has the ball, if it walks straight to meet it.

    Args:
        x: Position of the ball relative to the robot, m. A leading axis is for several robots.
        y: See `x`.
        vx: Velocity of the ball, m/s; rolling slows it down.
        vy: See `vx`.
        gap: Distance between the centres of robot and ball at which the robot has it, m.

    Returns:
        The time, as the environment computes it (`serp_envs.soccer.physics.rolling.meeting`),
        in steps of 0.2 s while the ball rolls; 0 for a ball in reach. For a robot that cannot
        reach the rolling ball, the time of its walk to where the ball comes to rest.
    """
    speed, slowing = np.hypot(vx, vy)[..., None], SPL_2020.ball_deceleration
    rolls = np.where(speed < STILL, 0.0, speed / slowing)
    time = np.minimum(_AHEAD, rolls)
    far = way(time, np.maximum(speed, STILL), slowing)
    there = np.hypot(x[..., None] + far * vx[..., None], y[..., None] + far * vy[..., None])
    needed = np.maximum(there - gap, 0.0) / NAO.forward
    # Every robot can meet the ball where it comes to rest.
    met = (needed <= _AHEAD) | (rolls <= _AHEAD)
    met[..., -1] = True
    first = np.argmax(met, axis=-1)[..., None]
    found: Numbers = np.maximum(np.take_along_axis(needed, first, -1), _AHEAD[first])
    return found[..., 0]


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the fluents of an observation, or of a batch of them.

    Args:
        observation: Of shape `(..., 17)`, as `CornerKickDefender` describes it.

    Returns:
        float64 of shape `(..., 9)`, in the order of the domain file; truth values are 0 and 1:

        * taken: the corner has been taken;
        * kicked: 0, it lasts only within a step;
        * robot-to-ball: m;
        * ball-in: seconds until the robot has the ball in reach, if it goes to meet it;
        * shot-in: seconds until the opponent can shoot: it goes to meet the ball, walks round it
          until it is behind it as seen from the goal, and winds up;
        * robot-to-mark: distance to the place between opponent and goal that marks it, m;
        * robot-to-opponent: m;
        * off-line: angle at the ball between the robot and the middle of the goal, 0 to π;
        * goal-open: share of the goal outside the robot's shadow as seen from the ball, 0 to 1,
          roughly (`open_share`).
    """
    seen = np.asarray(observation, dtype=np.float64)
    # From the middle of the goal, x up the pitch, y to the side of the corner.
    robot_x, robot_y = UNIT * seen[..., 0], UNIT * seen[..., 1]
    opponent_x, opponent_y = UNIT * seen[..., 2], UNIT * seen[..., 3]
    x, y = UNIT * seen[..., 4], UNIT * seen[..., 5]
    to_goal = np.arctan2(-y, -x)
    robot_to_ball = np.hypot(robot_x - x, robot_y - y)

    ball_in, its_ball_in = until_met(
        np.stack((x - robot_x, x - opponent_x)),
        np.stack((y - robot_y, y - opponent_y)),
        seen[..., 6],
        seen[..., 7],
        CONTACT + REACH,
    )
    turn = _between(to_goal, np.arctan2(y - opponent_y, x - opponent_x))
    shot_in = (
        its_ball_in
        + ROUND * np.maximum(turn - ALIGNED_SHOT, 0.0)
        + WIND_UP * (1.0 - np.minimum(seen[..., 13], 1.0))
    )

    share = 1.0 - MARK_GAP / np.maximum(np.hypot(opponent_x, opponent_y), MARK_GAP)
    off_line = _between(to_goal, np.arctan2(robot_y - y, robot_x - x))
    # How wide the goal looks: less from the side than from straight ahead.
    right, left = np.arctan2(y - SPL_2020.half_goal, x), np.arctan2(y + SPL_2020.half_goal, x)
    half_goal = np.maximum(0.5 * _between(left, right), 1e-3)
    return np.stack(
        (
            seen[..., 12] > 0.5,
            np.zeros_like(x),
            robot_to_ball,
            ball_in,
            shot_in,
            np.hypot(robot_x - share * opponent_x, robot_y - share * opponent_y),
            np.hypot(robot_x - opponent_x, robot_y - opponent_y),
            off_line,
            open_share(robot_to_ball, off_line, half_goal),
        ),
        axis=-1,
    )


def _between(one: Numbers, other: Numbers) -> Numbers:
    """Return the angle between two directions in [−π, π]: 0 to π."""
    apart = np.abs(one - other)
    return np.minimum(apart, 2.0 * np.pi - apart)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="corner-kick",
        # Grounding and domain file have the distances of its default field.
        make_env=partial(gym.make, "serp_envs:serp/CornerKick-v0"),
        domain=domain_file("corner-kick"),
        ground=ground,
        actions={
            "mark-near-post": 0,
            "mark-far-post": 1,
            "mark-attacker": 2,
            "intercept": 3,
            "clear": 4,
            "charge-opponent": 5,
        },
        dt=DECISION,
        # The domain's rewards estimate a situation; the environment's state what happened.
        reward="environment",
        settings=PROTOCOL,
        counters=("unsafe_choices", "damaging_hits"),
        description="keep a corner kick out of the goal: mark, intercept, clear",
    )
