"""The hill task: `serp_envs`' car in a valley; the domain file says only what is wanted."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file
from serp_envs.hill import CONTROL_PERIOD


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="hill",
        make_env=partial(gym.make, "serp_envs:serp/Hill-v0"),
        domain=domain_file("hill"),
        ground=as_observed,  # Position (m) and velocity (m/s) of the car.
        actions={"drive-left": 0, "coast": 1, "drive-right": 2},
        dt=CONTROL_PERIOD,
        description="drive a car up a hill that its engine can climb only with a run-up",
    )
