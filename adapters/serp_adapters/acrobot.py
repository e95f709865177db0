"""The acrobot task: Gymnasium's Acrobot-v1; the domain file says only what is wanted."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file

CONTROL_PERIOD = 0.2
"""Seconds between two decisions (Gymnasium's `dt`)."""


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="acrobot",
        make_env=partial(gym.make, "Acrobot-v1"),
        domain=domain_file("acrobot"),
        # Cosine and sine of both joints' angles, and their velocities (rad/s).
        ground=as_observed,
        actions={"turn-left": 0, "let-go": 1, "turn-right": 2},
        dt=CONTROL_PERIOD,
        description="swing up two links by the joint between them, from rewards alone",
    )
