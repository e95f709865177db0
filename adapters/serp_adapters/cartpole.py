"""The cart-pole task: `serp_envs`' environment, grounded in its four fluents."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
import serp_envs
from serp_adapters.domains import domain_file

CONTROL_PERIOD = 0.02
"""Seconds between two decisions (Gymnasium's `tau`)."""


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment, with the time limit of 500 steps."""
    serp_envs.register()
    return gym.make("serp/CartPole-v0", **options)


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return cart position (m), cart velocity (m/s), pole angle (rad), pole velocity (rad/s).

    The observation has them in the order of the domain file.
    """
    return np.asarray(observation, dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="cartpole",
        make_env=make_env,
        domain=domain_file("cartpole"),
        ground=ground,
        actions={"push-left": 0, "push-right": 1},
        dt=CONTROL_PERIOD,
        # A fall costs more than any step can gain, so this threshold refuses falls alone.
        # What is explored near the track's end ends in a fall; every step earns 1.
        settings={
            "*": {"arbiter": {"r_min": -0.5}},
            "default": {"arbiter": {"exploration_slack": 0.2}},
        },
        symmetries=(
            serp.Symmetry(
                flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
                actions={"push-left": "push-right"},
                observation_signs=(-1, -1, -1, -1),
            ),
        ),
        description="keep a pole upright on a cart that can be pushed left or right",
    )
