"""The cart-pole task: `serp_envs`' environment, grounded in its four fluents."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import cos, sin

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file

CONTROL_PERIOD = 0.02
"""Seconds between two decisions (Gymnasium's `tau`)."""


def draw(fluents: Mapping[str, float | bool]) -> str:
    """Return a picture of cart and pole, in metres; the marks are the ends of the track."""
    x, angle = (float(fluents[name]) for name in ("cart-position", "pole-angle"))
    top_x, top_y = x + sin(angle), -0.15 - cos(angle)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-3 -1.45 6 1.75">'
        '<path d="M-2.8 0H2.8M-2.4 -.12V.12M2.4 -.12V.12" fill="none" stroke-width=".02" '
        'style="stroke:var(--faint, #5b6472)"/>'
        f'<rect x="{x - 0.25:.4f}" y="-.3" width=".5" height=".3" rx=".04" '
        'style="fill:var(--ink, #1f2430)"/>'
        f'<path d="M{x:.4f} -.15L{top_x:.4f} {top_y:.4f}" stroke-width=".09" '
        'stroke-linecap="round" style="stroke:var(--good, #0a4a94)"/></svg>'
    )


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="cartpole",
        make_env=partial(gym.make, "serp_envs:serp/CartPole-v0"),
        domain=domain_file("cartpole"),
        # Cart position (m) and velocity (m/s), pole angle (rad) and velocity (rad/s).
        ground=as_observed,
        actions={"push-left": 0, "push-right": 1},
        dt=CONTROL_PERIOD,
        # A fall costs more than any step can gain, so this threshold refuses falls alone.
        settings={"*": {"arbiter": {"r_min": -0.5}}},
        draw=draw,
        description="keep a pole upright on a cart that can be pushed left or right",
    )
