"""The mountain car task: Gymnasium's MountainCar-v0; the domain file says only what is wanted."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="mountain-car",
        make_env=partial(gym.make, "MountainCar-v0"),
        domain=domain_file("mountain-car"),
        ground=as_observed,  # Position, and its change in a step.
        actions={"drive-left": 0, "coast": 1, "drive-right": 2},
        description="find the way up a hill that the engine is too weak for, from rewards alone",
    )
