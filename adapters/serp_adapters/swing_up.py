"""The swing-up task: `serp_envs`' pendulum; the domain file says only what is wanted."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file
from serp_envs.swing_up import CONTROL_PERIOD


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="swing-up",
        make_env=partial(gym.make, "serp_envs:serp/SwingUp-v0"),
        domain=domain_file("swing-up"),
        ground=as_observed,  # Height and side (m) and velocity (rad/s) of the pendulum.
        actions={"turn-left": 0, "let-go": 1, "turn-right": 2},
        dt=CONTROL_PERIOD,
        description="swing up a pendulum that its motor is too weak to lift, and hold it",
    )
