"""A picture of what the fluents of the soccer task say, from above."""

from __future__ import annotations

from collections.abc import Mapping
from math import acos, cos, pi, sin

from serp_envs.soccer.fields import SPL_2020

_NEAR, _FAR = 1.3, 2.0
"""Where the goal is drawn, in range or not: nearer than it is, so that the robots are large."""


def draw(fluents: Mapping[str, float | bool]) -> str:
    """Return a picture with the ball in the middle and the defended goal below it.

    The fluents are distances and an angle. They leave open how far the goal is, on which side of
    the line to the goal the robot is (here the right), and on which side of the robot the opponent
    (here away from a side that is free).
    """
    numbers = {name: float(value) for name, value in fluents.items()}
    goal = _NEAR if fluents["in-range"] else _FAR
    off, far = numbers["off-line"], numbers["robot-to-ball"]
    robot = far * sin(off), far * cos(off)
    away = numbers["opponent-to-ball"]
    turn = _angle(far, away, numbers["robot-to-opponent"])
    side = -1.0 if fluents["free right"] and not fluents["free left"] else 1.0
    opponent = away * sin(off + side * turn), away * cos(off + side * turn)
    half = SPL_2020.half_goal
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-1.5 -1.1 3 3.4">'
        f'<path d="M-1.5 {goal}H1.5" stroke-width=".02" style="stroke:var(--faint, #5b6472)"/>'
        f'<path d="M{-half} {goal}v.25h{2 * half}v-.25" fill="none" stroke-width=".06" '
        'style="stroke:var(--ink, #1f2430)"/>'
        f'<path d="M{-half} {goal}L0 0L{half} {goal}" stroke="none" '
        'style="fill:var(--glow, #e8f0fa)"/>'
        + _robot("robot", robot, "var(--good, #0a4a94)")
        + _robot("opponent", opponent, "var(--bad, #b5271b)")
        + '<circle r=".07" stroke-width=".03" style="fill:var(--surface, #fff); '
        'stroke:var(--ink, #1f2430)"/></svg>'
    )


def _angle(first: float, second: float, opposite: float) -> float:
    """Return the angle between two sides of a triangle; distances that make none are stretched."""
    if first <= 0.0 or second <= 0.0:
        return pi
    cosine = (first**2 + second**2 - opposite**2) / (2 * first * second)
    return acos(min(1.0, max(-1.0, cosine)))


def _robot(name: str, place: tuple[float, float], colour: str) -> str:
    x, y = place
    return (
        f'<circle cx="{x:.3f}" cy="{y:.3f}" r=".15" style="fill:{colour}">'
        f"<title>{name}</title></circle>"
        f'<text x="{x + 0.2:.3f}" y="{y + 0.06:.3f}" font-size=".2" '
        f'style="fill:{colour}">{name}</text>'
    )
