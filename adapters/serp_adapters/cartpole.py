"""The cart-pole task: `serp_envs`' environment, grounded in its four fluents."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file

CONTROL_PERIOD = 0.02
"""Seconds between two decisions (Gymnasium's `tau`)."""


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
        symmetries=(
            serp.Symmetry(
                flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
                actions={"push-left": "push-right"},
                observation_signs=(-1, -1, -1, -1),
            ),
        ),
        description="keep a pole upright on a cart that can be pushed left or right",
    )
