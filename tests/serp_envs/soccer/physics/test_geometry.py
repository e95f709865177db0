"""Angles, lanes, shadows, against hand-computed situations and rays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp_envs.soccer.physics.geometry import goal_coverage


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
