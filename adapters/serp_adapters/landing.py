"""The landing task: `serp_envs`' lander; the domain file says only what is wanted."""

from __future__ import annotations

from functools import partial

import gymnasium as gym

import serp
from serp_adapters.domains import as_observed, domain_file
from serp_envs.landing import CONTROL_PERIOD


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="landing",
        make_env=partial(gym.make, "serp_envs:serp/Landing-v0"),
        domain=domain_file("landing"),
        # Offset and height (m), velocity sideways and upwards (m/s) of the lander.
        ground=as_observed,
        actions={"fall": 0, "push-left": 1, "push-right": 2, "brake": 3},
        dt=CONTROL_PERIOD,
        # No step costs half as much as a crash, so this threshold refuses crashes alone.
        settings={"*": {"arbiter": {"r_min": -5.0}}},
        counters=("landed", "crashed", "lost"),
        description="land softly on a pad, after a fall through thick air",
    )
