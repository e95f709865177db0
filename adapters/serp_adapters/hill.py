"""The hill task: `serp_envs`' car in a valley; the domain file says only what is wanted."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
import serp_envs
from serp_adapters.domains import domain_file
from serp_envs.hill import CONTROL_PERIOD


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment, with the time limit of 200 steps."""
    serp_envs.register()
    return gym.make("serp/Hill-v0", **options)


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return position (m) and velocity (m/s) of the car.

    The observation has them in the order of the domain file.
    """
    return np.asarray(observation, dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="hill",
        make_env=make_env,
        domain=domain_file("hill"),
        ground=ground,
        actions={"drive-left": 0, "coast": 1, "drive-right": 2},
        dt=CONTROL_PERIOD,
        # Twelve decisions, 1.2 s: down one side and up the other.
        settings={"*": {"planner": {"depth": 4, "repeat": 3}}},
        description="drive a car up a hill that its engine is too weak for without a run-up",
    )
