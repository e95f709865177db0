"""The soccer task: its fluents, and the planner's choice in typical situations."""

from __future__ import annotations

from math import asin, atan2, hypot

import numpy as np
import pytest
from numpy.typing import NDArray

from serp.tasks.task import BoundTask
from serp_adapters.soccer import defender as soccer
from tests.serp_adapters.test_soccer_tasks import planner_of

Point = tuple[float, float]
Vector = NDArray[np.float64]


@pytest.fixture(scope="module")
def task() -> BoundTask:
    return soccer.task().bind()


def observation(robot: Point, opponent: Point, to_goal: float = 2.0) -> Vector:
    """An observation, from places in metres: the ball is at (0, 0), the goal along x."""
    vector = np.zeros(16)
    vector[0:4] = np.array((*robot, *opponent)) / 0.5
    vector[[6, 8]] = -1.0
    vector[10] = to_goal / 3.0
    return vector


# Grounding -------------------------------------------------------------------------------------


def test_grounding_agrees_with_the_poses_of_info(task: BoundTask) -> None:
    names = [f.name for f in task.model.fluents]
    raw, info = task.reset(seed=9)
    for _ in range(30):
        values = dict(zip(names, soccer.ground(raw).tolist(), strict=True))
        ball = np.array((info["ball_x"], info["ball_y"]))
        robot = np.array((info["defender_x"], info["defender_y"])) - ball
        opponent = np.array((info["attacker_x"], info["attacker_y"])) - ball
        goal = np.array((-4.5, 0.0)) - ball
        cosine = robot @ goal / (hypot(*robot) * hypot(*goal))
        half = atan2(0.75, hypot(*goal))
        shadow = asin(0.2 / max(0.2, hypot(*robot)))
        share = min(1.0, max(0.0, (np.arccos(cosine) + half - shadow) / (2 * half)))
        assert values["robot-to-ball"] == pytest.approx(hypot(*robot), abs=1e-5)
        assert values["opponent-to-ball"] == pytest.approx(hypot(*opponent), abs=1e-5)
        assert values["robot-to-opponent"] == pytest.approx(hypot(*(robot - opponent)), abs=1e-5)
        assert values["off-line"] == pytest.approx(np.arccos(cosine), abs=1e-3)
        assert values["goal-open"] == pytest.approx(share, abs=2e-3)
        assert values["in-range"] == (hypot(*goal) < 3.0)
        raw, _, terminated, truncated, info = task.step(0)
        if terminated or truncated:
            raw, info = task.reset()


# Domain and planner ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "opponent", "to_goal", "action"),
    [
        ((0.25, 0.0), (-0.2, 0.15), 2.0, "side-advance left"),  # in reach, opponent to the right
        ((0.25, 0.0), (-0.2, -0.15), 2.0, "side-advance right"),
        ((0.25, 0.0), (-0.65, 0.0), 3.5, "frontal-contrast"),  # alone with the ball
        ((0.25, 0.0), (-0.3, 0.0), 2.0, "cover-goal"),  # barred on both sides
        ((0.6, 0.1), (-0.45, 0.0), 2.0, "cover-goal"),  # too far away, and it will shoot
    ],
)
def test_the_planner_does_what_a_coach_would(
    task: BoundTask, robot: Point, opponent: Point, to_goal: float, action: str
) -> None:
    state = soccer.ground(observation(robot, opponent, to_goal))
    assert task.actions.name(planner_of(task).plan(state).action) == action
