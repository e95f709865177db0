"""The soccer task: its environment, its grounding in distances, angles and free sides."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp_adapters.domains import domain_file
from serp_adapters.soccer.drawing import draw
from serp_adapters.soccer.shared import PROTOCOL, open_share
from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.observation import FAR, NEAR
from serp_envs.soccer.physics.periods import DECISION

FREE_ANGLE: Final = 0.2
"""A side is free if the opponent is at least this far on the other side, rad at the ball."""
FREE_DISTANCE: Final = 0.6
"""Both sides are free if the opponent is farther than this from the ball, m."""
LINED_ANGLE: Final = 0.5
"""Largest deviation of the opponent from the line through robot and ball, rad at the ball."""
SHOT_RANGE: Final = 3.0
"""Largest distance to the middle of the goal from which a shot is dangerous, m."""


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the fluents of an observation, or of a batch of them.

    Args:
        observation: Of shape `(..., 16)`, as `SoccerDefender` describes it.

    Returns:
        float64 of shape `(..., 11)`, in the order of the domain file; truth values are 0 and 1:

        * free left, free right: a ball pushed there gets past the opponent, which is on the other
          side of the line from the robot through the ball, or far away;
        * lined: the opponent is on that line, behind the ball;
        * in-range: the ball is less than 3 m from the middle of the goal;
        * pushed left, pushed right: 0, they last only within a step;
        * robot-to-ball, opponent-to-ball, robot-to-opponent: m;
        * off-line: angle at the ball between the robot and the middle of the goal, 0 to π;
        * goal-open: share of the goal outside the robot's shadow as seen from the ball, 0 to 1,
          roughly (`open_share`).
    """
    seen = np.asarray(observation, dtype=np.float64)
    # Places in the frame of the observation: the ball is its origin, x points to the goal.
    robot_x, robot_y = NEAR * seen[..., 0], NEAR * seen[..., 1]
    opponent_x, opponent_y = NEAR * seen[..., 2], NEAR * seen[..., 3]
    to_goal = FAR * seen[..., 10]
    robot_to_ball = np.hypot(robot_x, robot_y)
    opponent_to_ball = np.hypot(opponent_x, opponent_y)

    # How far the opponent, seen from the ball, is left (+) of where the robot looks, rad.
    beside = np.arctan2(
        robot_y * opponent_x - robot_x * opponent_y, -robot_x * opponent_x - robot_y * opponent_y
    )
    away = opponent_to_ball > FREE_DISTANCE

    off_line = np.abs(np.arctan2(robot_y, robot_x))
    half_goal = np.arctan2(SPL_2020.half_goal, to_goal)
    goal_open = open_share(robot_to_ball, off_line, half_goal)

    never = np.zeros_like(to_goal)
    return np.stack(
        (
            away | (beside <= -FREE_ANGLE),
            away | (beside >= FREE_ANGLE),
            np.abs(beside) < LINED_ANGLE,
            to_goal < SHOT_RANGE,
            never,
            never,
            robot_to_ball,
            opponent_to_ball,
            np.hypot(robot_x - opponent_x, robot_y - opponent_y),
            off_line,
            goal_open,
        ),
        axis=-1,
    )


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="soccer",
        # Grounding and domain file have the distances of its default field.
        make_env=partial(gym.make, "serp_envs:serp/SoccerDefender-v0"),
        domain=domain_file("soccer"),
        ground=ground,
        actions={
            "cover-goal": 0,
            "side-advance left": 1,
            "side-advance right": 2,
            "frontal-contrast": 3,
            "charge-opponent": 4,
        },
        dt=DECISION,
        # The domain's rewards estimate a situation; the environment's state what happened.
        reward="environment",
        settings=PROTOCOL,
        draw=draw,
        counters=("unsafe_choices", "damaging_hits"),
        description="defend the goal against an attacker who comes with the ball",
    )
