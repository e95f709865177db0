"""The tidying robot: `serp_envs`' mobile manipulator, grounded in places, things and distances."""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp.errors import MissingExtra
from serp_adapters.domains import domain_file

if find_spec("mujoco") is None:
    raise MissingExtra("the tidying robot (`tidy`)", "mujoco")

from serp_envs.tidy import MACROS, OBSERVED, PLACES, THINGS, Pose, lies_on_table, stands_at

Numbers = NDArray[np.float64]


def ground(observation: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the fluents of an observation, or of a batch of them.

    Args:
        observation: Of shape `(..., 35)`, as `serp_envs.tidy.TidyRoom` describes it.

    Returns:
        float64 of shape `(..., 32)`, in the order of the domain file; truth values are 0 and 1.
    """
    seen: Numbers = np.asarray(observation, dtype=np.float64)
    number = {name: seen[..., k] for k, name in enumerate(OBSERVED)}
    x, y = number["x"], number["y"]
    heading = number["cos-heading"], number["sin-heading"]
    at = {place: stands_at(place, x, y, *heading) for place in PLACES}
    on_table, ahead = [], []
    for name in THINGS:
        rests = lies_on_table(*(number[f"{axis} {name}"] for axis in "xyz"))
        on_table.append(rests & (number[f"held {name}"] < 0.5))
        ahead.append(at["table"] & on_table[-1] & (abs(number[f"y {name}"] - y) < 0.05))
    columns = [
        *(at[place] for place in PLACES),
        *ahead,
        *on_table,
        *(number[f"{what} {name}"] for what in ("held", "tidy", "lost") for name in THINGS),
        number["hit"],
        number["spilled"],
        number["battery"],
        number["opening"],
        *(_gap(number, x, y, pose) for pose in PLACES.values()),
    ]
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=-1)


def _gap(number: dict[str, Numbers], x: Numbers, y: Numbers, to: Pose) -> Numbers:
    """Return the distance of the person from the straight way to a place, m."""
    way_x, way_y = to.x - x, to.y - y
    px, py = number["person-x"] - x, number["person-y"] - y
    along = (px * way_x + py * way_y) / np.maximum(way_x**2 + way_y**2, 1e-9)
    share = np.clip(along, 0.0, 1.0)
    return np.hypot(px - share * way_x, py - share * way_y)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="tidy",
        make_env=partial(gym.make, "serp_envs:serp/TidyRoom-v0"),
        domain=domain_file("tidy"),
        ground=ground,
        actions={name: number for number, name in enumerate(MACROS)},
        # The file's are guesses.
        reward="environment",
        # Else each of 23 actions is tried four times, which costs the first episode.
        settings={"*": {"adaptation": {"mode": "off"}}},
        counters=("hit", "spilled", "empty", "dropped", "tidied"),
        description="clear a table into a drawer and a shelf, around a person",
    )
