"""The swing-up task: `serp_envs`' pendulum; the domain file says only what is wanted."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
import serp_envs
from serp_adapters.domains import domain_file
from serp_envs.swing_up import CONTROL_PERIOD


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment, with the time limit of 200 steps."""
    serp_envs.register()
    return gym.make("serp/SwingUp-v0", **options)


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return height (m), side (m) and velocity (rad/s) of the pendulum.

    The observation has them in the order of the domain file.
    """
    return np.asarray(observation, dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="swing-up",
        make_env=make_env,
        domain=domain_file("swing-up"),
        ground=ground,
        actions={"turn-left": 0, "let-go": 1, "turn-right": 2},
        dt=CONTROL_PERIOD,
        # Sixteen decisions, 0.8 s: about half a swing.
        settings={"*": {"planner": {"depth": 4, "repeat": 4}}},
        symmetries=(
            serp.Symmetry(
                flip=("side", "velocity"),
                actions={"turn-left": "turn-right"},
                observation_signs=(1, -1, -1),
            ),
        ),
        description="swing up a pendulum that its motor is too weak to lift, and hold it",
    )
