"""The corner-kick task: its fluents, and the planner's choice in typical situations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from serp.tasks.task import BoundTask
from serp_adapters.soccer import corner_kick
from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.physics.rolling import meeting
from tests.serp_adapters.test_soccer_tasks import planner_of

Point = tuple[float, float]
Vector = NDArray[np.float64]


@pytest.fixture(scope="module")
def task() -> BoundTask:
    return corner_kick.task().bind()


def observation(
    robot: Point,
    opponent: Point,
    ball: Point,
    velocity: Point = (0.0, 0.0),
    *,
    taken: bool = True,
    wind_up: float = 0.0,
) -> Vector:
    """An observation, from places in metres: the goal is at (0, 0), x up the pitch."""
    vector = np.zeros(17)
    vector[0:6] = np.array((*robot, *opponent, *ball)) / 2.0
    vector[6:8] = velocity
    vector[[8, 10]] = -1.0
    vector[12:14] = taken, wind_up
    return vector


# Grounding -------------------------------------------------------------------------------------


def test_the_ball_is_met_where_the_environment_sends_the_robots(task: BoundTask) -> None:
    scenario = task.env.unwrapped.scenario
    assert isinstance(scenario, CornerKick)
    task.reset(seed=3)
    rolling = 0
    for _ in range(300):
        world = scenario.world
        for robot in world.robots[:2]:
            found = corner_kick.until_met(
                *np.array((world.ball_x - robot.x, world.ball_y - robot.y)),
                *np.array((world.ball_vx, world.ball_vy)),
                gap=world.contact,
            )
            assert found == pytest.approx(meeting(world, robot)[2])
        rolling += world.ball_vx != 0.0
        _, _, terminated, truncated, _ = task.step(3)
        if terminated or truncated:
            task.reset()
    assert rolling > 100


# Domain and planner ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("places", "options", "action"),
    [
        # The opponent stands free, the ball lies at the corner.
        (((0.6, -0.5), (1.2, 0.6), (0.05, 2.95)), {"taken": False}, "mark-attacker"),
        # The ball comes across, slower and slower, and will lie a step away.
        (((0.6, 0.0), (1.8, 0.0), (0.6, 1.2), (0.0, -0.6)), {}, "intercept"),
        # It lies in reach, the goal behind the robot.
        (((0.5, 0.0), (1.3, 0.0), (0.75, 0.0)), {}, "clear"),
        # The opponent will shoot before the robot is there, and the goal is open.
        (((0.5, 0.2), (1.45, 0.0), (1.2, 0.0)), {}, "mark-attacker"),
        # The ball is in reach, but from here the robot would kick it into its own goal.
        (((1.0, 0.0), (2.5, 1.5), (0.75, 0.0)), {}, "mark-attacker"),
    ],
)
def test_the_planner_does_what_a_coach_would(
    task: BoundTask, places: tuple[Point, ...], options: dict[str, Any], action: str
) -> None:
    state = corner_kick.ground(observation(*places, **options))
    forecast = planner_of(task).plan(state).forecast
    best = np.isclose(forecast.value, forecast.value[forecast.choice], rtol=1e-9)
    assert action in {task.actions.name(int(k)) for k in np.flatnonzero(best)}
