"""Shared by both soccer tasks: the open share of the goal, and the settings of training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from serp_envs.soccer.fields import SPL_2020
from serp_envs.soccer.physics.robot import NAO

Numbers: TypeAlias = NDArray[np.floating[Any]]
"""One number per observation, of any shape."""

CONTACT: Final = NAO.radius + SPL_2020.ball_radius
"""Distance between the centres of a robot and a ball that it touches, m. The ball cannot pass the
robot at a smaller distance, so this is also half the width of the robot's shadow."""


PROTOCOL: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {
    # The paper's iteration is a game, of about 33 episodes; 28 games make a cycle (section 4.2).
    # R_min refuses what the domain expects to end with a goal or a collision, and allows what loses
    # the ball.
    "paper": {"arbiter": {"rho_increment": 0.003, "r_min": -5.0}, "training": {"env_steps": 24_000}}
}
"""Settings of both tasks for preset `paper`."""


def open_share(robot_to_ball: Numbers, off_line: Numbers, half_goal: Numbers) -> Numbers:
    """Return the share of the goal outside the robot's shadow as seen from the ball.

    An approximation: the goal is assumed to be perpendicular to the line to the ball, and the part
    that is open on the other side of a robot on the line is not counted.

    Args:
        robot_to_ball: Distance, m.
        off_line: Angle at the ball between the robot and the middle of the goal, 0 to π.
        half_goal: Half the angle that the goal takes up at the ball, above 0.

    Returns:
        0 (no way past) to 1 (wide open).
    """
    half_shadow = np.arcsin(CONTACT / np.maximum(robot_to_ball, CONTACT))
    return np.clip((off_line + half_goal - half_shadow) / (2.0 * half_goal), 0.0, 1.0)
