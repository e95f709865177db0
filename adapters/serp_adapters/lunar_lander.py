"""The lunar lander task (extra `box2d`): Gymnasium's LunarLander-v3, in metres and seconds.

Importing this module without Box2D raises `serp.errors.MissingExtra`.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp.errors import MissingExtra
from serp_adapters.domains import domain_file

if find_spec("Box2D") is None:
    raise MissingExtra("the lunar lander (`lunar-lander`)", "box2d")

CONTROL_PERIOD: Final = 0.02
"""Seconds between two decisions."""
UNITS: Final = np.array([10.0, 20.0 / 3.0, 5.0, 7.5, 1.0, 2.5])
"""What 1 in each of the first six numbers of an observation is in m, m/s, rad and rad/s."""


def ground(observation: NDArray[np.floating[Any]]) -> dict[str, float | bool]:
    """Return place, velocity, lean and spin of the lander, and which legs touch the ground."""
    names = ("offset", "height", "sideways", "upwards", "lean", "spin")
    state: dict[str, float | bool] = dict(
        zip(names, (observation[:6] * UNITS).tolist(), strict=True)
    )
    state["touches left-leg"], state["touches right-leg"] = map(bool, observation[6:] > 0.5)
    return state


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="lunar-lander",
        make_env=partial(gym.make, "LunarLander-v3"),
        domain=domain_file("lunar-lander"),
        ground=ground,
        actions={"fall": 0, "push-left": 1, "brake": 2, "push-right": 3},
        dt=CONTROL_PERIOD,
        # The file's hints are for the planner.
        reward="environment",
        description="land a craft with three engines softly on a pad between hills",
    )
