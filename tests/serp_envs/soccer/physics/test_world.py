"""The physics: rolling, walking, kicks, and what a robot covers of the goal."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp_envs.soccer.fields import FIELDS, SPL_2020, Field
from serp_envs.soccer.physics.geometry import goal_coverage
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World

FAR = ((-4.0, 2.5, 0.0), (4.0, -2.5, 0.0))


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_a_rolling_ball_slows_down_by_the_carpets_deceleration(field: Field) -> None:
    world = World(field, NAO, (0.0, 0.0), FAR)
    world.kick(0.0, 1.5, np.random.default_rng(0))
    speed = world.ball_vx
    assert 1.35 <= speed <= 1.65
    for _ in range(10):
        world.advance()
    assert world.ball_vx == pytest.approx(speed - 0.30, abs=1e-9)
    assert world.ball_vy == 0.0
    for _ in range(60):
        world.advance()
    assert (world.ball_vx, world.ball_vy) == (0.0, 0.0)
    assert world.ball_x == pytest.approx(speed**2 / 0.6, rel=0.02)


@pytest.mark.parametrize(
    ("target", "speed"), [((3.0, 0.0), 0.25), ((-3.0, 0.0), 0.15), ((0.0, 3.0), 0.20)]
)
def test_walks_keep_to_the_limits_of_their_direction(
    target: tuple[float, float], speed: float
) -> None:
    world = World(SPL_2020, NAO, (0.0, 2.9), ((0.0, 0.0, 0.0), FAR[1]))
    robot = world.robots[0]
    for _ in range(20):
        robot.go_to(*target, robot.x + 1.0, robot.y)  # keeps looking along x
        world.advance()
    start = (robot.x, robot.y)
    for _ in range(10):
        robot.go_to(*target, robot.x + 1.0, robot.y)
        world.advance()
    assert math.dist(start, (robot.x, robot.y)) == pytest.approx(speed, rel=1e-3)


def test_a_shot_does_not_pass_a_robot() -> None:
    world = World(SPL_2020, NAO, (0.0, 0.0), ((-1.0, 0.0, 0.0), FAR[1]))
    world.kick(math.pi, 1.5, np.random.default_rng(0))
    for _ in range(15):
        world.advance()
    assert world.ball_vx > -1e-9
    assert world.ball_x > -0.82  # touching, and a little overlap


@settings(max_examples=60, deadline=None)
@given(
    ball=st.tuples(st.floats(-4.3, 0.0), st.floats(-2.8, 2.8)),
    robot=st.tuples(st.floats(-4.5, 0.0), st.floats(-2.8, 2.8)),
)
def test_coverage_is_the_share_of_rays_that_meet_the_robot(
    ball: tuple[float, float], robot: tuple[float, float]
) -> None:
    (bx, by), (rx, ry) = ball, robot
    if math.hypot(bx - rx, by - ry) < 0.21:
        return
    low = math.atan2(-0.75 - by, -4.5 - bx) % (2 * math.pi)
    high = math.atan2(0.75 - by, -4.5 - bx) % (2 * math.pi)
    rays = np.linspace(low, high, 4001)
    along = (rx - bx) * np.cos(rays) + (ry - by) * np.sin(rays)
    aside = np.abs((ry - by) * np.cos(rays) - (rx - bx) * np.sin(rays))
    share = float(np.mean((along > 0.0) & (aside < 0.2)))
    assert goal_coverage(bx, by, rx, ry, 0.2, -4.5, 0.75) == pytest.approx(share, abs=2e-3)
    mirrored = goal_coverage(bx, -by, rx, -ry, 0.2, -4.5, 0.75)
    assert mirrored == pytest.approx(goal_coverage(bx, by, rx, ry, 0.2, -4.5, 0.75))
