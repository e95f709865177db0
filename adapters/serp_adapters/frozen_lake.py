"""The frozen lake task: Gymnasium's FrozenLake-v1, 8 × 8 and slippery."""

from __future__ import annotations

from typing import Any, Final, SupportsInt

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp_adapters.domains import domain_file

SIZE: Final = 8
"""Rows and columns of the lake."""


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment; options are those of Gymnasium's `FrozenLake8x8-v1`."""
    return gym.make("FrozenLake8x8-v1", **options)


def ground(observation: SupportsInt) -> NDArray[np.float64]:
    """Return row (0 to 7, from above) and column (0 to 7, from the left) of a cell (0 to 63)."""
    return np.array(divmod(int(observation), SIZE), dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="frozen-lake",
        make_env=make_env,
        domain=domain_file("frozen-lake"),
        ground=ground,
        actions={"left": 0, "down": 1, "right": 2, "up": 3},
        description="cross a slippery lake around its holes",
    )
