"""The taxi task: Gymnasium's Taxi-v4, whole in its domain file."""

from __future__ import annotations

from typing import Any, Final, SupportsInt

import gymnasium as gym

import serp
from serp_adapters.domains import domain_file

PLACES: Final = ("red", "green", "yellow", "blue")
"""The places of the town in Gymnasium's order; a passenger aboard has the number after them."""


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment; options are those of Gymnasium's `Taxi-v4`."""
    return gym.make("Taxi-v4", **options)


def ground(observation: SupportsInt) -> dict[str, float | bool]:
    """Return where the taxi is, where the passenger is and wants to go.

    An observation is ((row · 5 + column) · 5 + passenger) · 4 + destination.
    """
    rest, destination = divmod(int(observation), 4)
    rest, passenger = divmod(rest, 5)
    row, column = divmod(rest, 5)
    state: dict[str, float | bool] = {
        "row": float(row),
        "column": float(column),
        "aboard": passenger == len(PLACES),
    }
    for number, place in enumerate(PLACES):
        state[f"waits {place}"] = number == passenger
        state[f"wanted {place}"] = number == destination
    return state


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="taxi",
        make_env=make_env,
        domain=domain_file("taxi"),
        ground=ground,
        actions={"south": 0, "north": 1, "east": 2, "west": 3, "pick-up": 4, "put-down": 5},
        # It charges 10 for a passenger who is not there, which the file has no word for.
        reward="environment",
        description="fetch a passenger and drive to where they want to go",
    )
