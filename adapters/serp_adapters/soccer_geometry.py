"""What the soccer tasks measure alike: distances of contact, the goal that is open to a shot."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.robot import NAO

Numbers: TypeAlias = NDArray[np.floating[Any]]
"""A number for each observation, in any shape."""

CONTACT: Final = NAO.radius + SPL_2020.ball_radius
"""Distance between the middles of a robot and a ball that it touches, m. The middle of the ball
cannot pass the robot's nearer than this, so the robot's shadow on the goal is so wide, too."""


def open_share(robot_to_ball: Numbers, off_line: Numbers, half_goal: Numbers) -> Numbers:
    """The share of the goal outside the robot's shadow as seen from the ball.

    Roughly: the goal is taken to stand square to the ball, and what is open on the far side of a
    robot on the line counts for nothing.

    Args:
        robot_to_ball: m.
        off_line: Angle at the ball between the robot and the middle of the goal, 0 to π.
        half_goal: Half the angle that the goal takes up at the ball, above 0.

    Returns:
        0 (no way past) to 1 (wide open).
    """
    half_shadow = np.arcsin(CONTACT / np.maximum(robot_to_ball, CONTACT))
    return np.clip((off_line + half_goal - half_shadow) / (2.0 * half_goal), 0.0, 1.0)
