"""Angles, intervals and shadows on the pitch. Plain floats: metres and radians."""

from __future__ import annotations

from math import asin, atan2, hypot, pi


def wrap(angle: float) -> float:
    """Return the same angle in [−π, π]; for angles within ±3π, such as sums of two angles."""
    if angle > pi:
        return angle - 2.0 * pi
    if angle < -pi:
        return angle + 2.0 * pi
    return angle


def along(interval: tuple[float, float], share: float) -> float:
    """Interpolate between the bounds of an interval; `share` is 0 to 1."""
    low, high = interval
    return low + share * (high - low)


def goal_coverage(
    ball_x: float,
    ball_y: float,
    robot_x: float,
    robot_y: float,
    radius: float,
    goal_x: float,
    half_goal: float,
) -> float:
    """Return the share of the goal mouth that a robot covers, as an angle at the ball.

    Args:
        ball_x: Where the ball is; in front of the goal line.
        ball_y: See `ball_x`.
        robot_x: Where the robot is.
        robot_y: See `robot_x`.
        radius: Of the robot and the ball together: the middle of the ball cannot pass nearer.
        goal_x: The goal line.
        half_goal: The goal mouth is y = ± this.

    Returns:
        0 (wide open) to 1 (no way past). 0 when the ball is on the goal line or behind it.
    """
    depth = ball_x - goal_x
    if depth <= 0.0:
        return 0.0
    # Angles relative to the direction straight at the goal line, counter-clockwise as one looks
    # from the ball along −x: y to the right is negative there.
    low = atan2(ball_y - half_goal, depth)
    high = atan2(ball_y + half_goal, depth)
    dx, dy = ball_x - robot_x, ball_y - robot_y
    distance = hypot(dx, dy)
    bearing = atan2(dy, dx)
    half = asin(radius / distance) if distance > radius else 0.5 * pi
    # A shadow may reach across ±π, behind the ball: shifted by 2π its other end may cover too.
    covered = 0.0
    for shift in (0.0, 2.0 * pi, -2.0 * pi):
        right, left = bearing - half + shift, bearing + half + shift
        right = low if right < low else right
        left = high if left > high else left
        if left > right:
            covered += left - right
    return covered / (high - low)
