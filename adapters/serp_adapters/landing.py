"""The landing task: `serp_envs`' lander; the domain file says only what is wanted."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
import serp_envs
from serp_adapters.domains import domain_file
from serp_envs.landing import CONTROL_PERIOD


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment, with the time limit of 200 steps."""
    serp_envs.register()
    return gym.make("serp/Landing-v0", **options)


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return offset and height (m), velocity sideways and upwards (m/s) of the lander.

    The observation has them in the order of the domain file.
    """
    return np.asarray(observation, dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="landing",
        make_env=make_env,
        domain=domain_file("landing"),
        ground=ground,
        actions={"fall": 0, "push-left": 1, "push-right": 2, "brake": 3},
        dt=CONTROL_PERIOD,
        settings={
            "*": {
                # Twelve decisions, 1.2 s: enough to brake from the speed that the file allows.
                "planner": {"depth": 4, "repeat": 3},
                # No step costs half as much as a crash, so this threshold refuses crashes alone.
                "arbiter": {"r_min": -5.0},
            }
        },
        symmetries=(
            serp.Symmetry(
                flip=("offset", "sideways"),
                actions={"push-left": "push-right"},
                observation_signs=(-1, 1, -1, 1),
            ),
        ),
        counters=("landed", "crashed", "lost"),
        description="land softly on a pad, after a fall through thick air",
    )
