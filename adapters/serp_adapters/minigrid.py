"""Two tasks on grids of MiniGrid (extra `minigrid`): a locked door, and four rooms.

Importing this module without MiniGrid raises `serp.errors.MissingExtra`.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import serp
from serp.errors import MissingExtra
from serp_adapters.domains import domain_file

if find_spec("minigrid") is None:
    raise MissingExtra("a grid of MiniGrid (`door-key`, `four-rooms`)", "minigrid")

WALL, DOOR, KEY, GOAL, AGENT = 2, 4, 5, 8, 10
"""MiniGrid's numbers of what a cell holds."""
OPEN: Final = 0
"""MiniGrid's number of the state of an open door."""
HEADINGS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""What lies one cell ahead of an agent with each of MiniGrid's directions."""
MIDDLE: Final = 9
"""x and y of the walls between four rooms."""

Grid = NDArray[np.integer[Any]]


def _make(name: str, **options: Any) -> gym.Env[Any, Any]:
    """Return an environment that shows the grid, `[x, y, (object, colour, state)]`."""
    import minigrid  # noqa: F401, it registers its environments; importing it takes a second
    from minigrid.wrappers import FullyObsWrapper, ImgObsWrapper

    made = gym.make(name, highlight=False, **options)  # pictures show all alike, as it is seen
    whole = FullyObsWrapper(made)  # type: ignore[no-untyped-call]
    return ImgObsWrapper(whole)  # type: ignore[no-untyped-call]


def make_door_key(**options: Any) -> gym.Env[Any, Any]:
    """Return `MiniGrid-DoorKey-8x8-v0`, its grid seen from above."""
    return _make("MiniGrid-DoorKey-8x8-v0", **options)


def make_four_rooms(**options: Any) -> gym.Env[Any, Any]:
    """Return `MiniGrid-FourRooms-v0`, its grid seen from above."""
    return _make("MiniGrid-FourRooms-v0", **options)


def _cells(grid: Grid, thing: int) -> list[tuple[int, int]]:
    return [(int(x), int(y)) for x, y in np.argwhere(grid[..., 0] == thing)]


def _agent(grid: Grid) -> dict[str, float | bool]:
    x, y = _cells(grid, AGENT)[0]
    dx, dy = HEADINGS[int(grid[x, y, 2])]
    return {"x": x, "y": y, "dx": dx, "dy": dy}


def ground_door_key(grid: Grid) -> dict[str, float | bool]:
    """Return where agent, wall, door and key are, from a grid `[8, 8, 3]`.

    A key that the agent has is at 0, 0.
    """
    state = _agent(grid)
    doors, keys = _cells(grid, DOOR), _cells(grid, KEY)
    # An agent in the doorway hides the door; it is open then.
    wall, door = doors[0] if doors else (int(state["x"]), int(state["y"]))
    state |= {"wall": wall, "door": door, "has-key": not keys}
    state["open"] = not doors or int(grid[wall, door, 2]) == OPEN
    state["key-x"], state["key-y"] = keys[0] if keys else (0, 0)
    return state


def ground_four_rooms(grid: Grid) -> dict[str, float | bool]:
    """Return where agent, goal and gaps are, from a grid `[19, 19, 3]`."""
    state = _agent(grid)
    goals = _cells(grid, GOAL)
    state["goal-x"], state["goal-y"] = goals[0] if goals else (state["x"], state["y"])
    free = grid[..., 0] != WALL
    state["gap-above"], state["gap-below"] = map(int, np.flatnonzero(free[MIDDLE]))
    state["gap-left"], state["gap-right"] = map(int, np.flatnonzero(free[:, MIDDLE]))
    return state


def door_key() -> serp.Task:
    """Return the task of the locked door."""
    return serp.Task(
        name="door-key",
        make_env=make_door_key,
        domain=domain_file("door-key"),
        ground=ground_door_key,
        actions={"left": 0, "right": 1, "forward": 2, "pick-up": 3, "toggle": 5},
        description="fetch a key, open a door and go to the goal",
    )


def four_rooms() -> serp.Task:
    """Return the task of the four rooms."""
    return serp.Task(
        name="four-rooms",
        make_env=make_four_rooms,
        domain=domain_file("four-rooms"),
        ground=ground_four_rooms,
        actions={"left": 0, "right": 1, "forward": 2},
        description="find the way to the goal through gaps between four rooms",
    )
