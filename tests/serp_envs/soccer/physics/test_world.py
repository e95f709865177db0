"""The physics: rolling, walking, kicks, and what a robot covers of the goal."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp_envs.soccer.fields import FIELDS
from serp_envs.soccer.physics.geometry import goal_coverage
from serp_envs.soccer.physics.robot import NAO
from serp_envs.soccer.physics.world import World

FAR = ((-4.0, 2.5, 0.0), (4.0, -2.5, 0.0))


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_a_rolling_ball_slows_down_by_the_carpets_deceleration(field):
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


@settings(max_examples=60, deadline=None)
@given(
    ball=st.tuples(st.floats(-4.3, 0.0), st.floats(-2.8, 2.8)),
    robot=st.tuples(st.floats(-4.5, 0.0), st.floats(-2.8, 2.8)),
)
def test_coverage_is_the_share_of_rays_that_meet_the_robot(ball, robot):
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
