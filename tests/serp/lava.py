"""A slippery grid with lava: what the file says of it is right but for the slipping.

Between two pools of lava every move does damage at times, so that no risk can be avoided there.
The lava costs nothing, and every step does: what keeps out of it is the flag alone.
"""

import functools
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.model.domain import Domain
from serp.tasks.task import Task
from tests.generated import Texts, load_texts

SIZE = 9
SLIP = 0.15
STEPS = 100
"""An episode is cut after so many."""
GOAL = (8, 8)
MOVES = {"north": (0, 1), "east": (1, 0), "south": (0, -1), "west": (-1, 0)}
LAVA = tuple((x, y) for x in range(1, SIZE, 2) for y in range(1, SIZE, 2))


class LavaGrid(gym.Env[NDArray[np.float64], np.int64]):
    """Moves by one cell, 15 times in 100 to the left or right of where it was told to go.

    Attributes:
        falls: How often it went into the lava.
    """

    def __init__(self) -> None:
        self.observation_space = spaces.Box(0.0, SIZE - 1.0, (2,), np.float64)
        self.action_space = spaces.Discrete(len(MOVES))
        self.falls = self.steps = 0
        self.place = (0, 0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        super().reset(seed=seed)
        free = [(x, y) for x in range(SIZE) for y in range(SIZE) if (x, y) not in (*LAVA, GOAL)]
        self.place, self.steps = free[int(self.np_random.integers(len(free)))], 0
        return np.array(self.place, dtype=np.float64), {}

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        self.steps += 1
        dx, dy = list(MOVES.values())[int(action)]
        if self.np_random.random() < SLIP:
            dx, dy = (dy, dx) if self.np_random.random() < 0.5 else (-dy, -dx)
        x, y = self.place[0] + dx, self.place[1] + dy
        if 0 <= x < SIZE and 0 <= y < SIZE:
            self.place = x, y
        fell, arrived = self.place in LAVA, self.place == GOAL
        self.falls += fell
        reward = -0.1 + 10.0 * arrived
        place = np.array(self.place, dtype=np.float64)
        return place, reward, fell or arrived, self.steps >= STEPS, {}


def _text() -> str:
    lines = [
        "(define (domain lava)",
        "  (:predicates (unsafe) (terminal))",
        "  (:functions (x) (y) (reward))",
    ]
    for name, (dx, dy) in MOVES.items():
        axis, change = ("x", dx) if dx else ("y", dy)
        border = f"(< ({axis}) {SIZE - 1})" if change > 0 else f"(> ({axis}) 0)"
        verb = "increase" if change > 0 else "decrease"
        lines.append(
            f"  (:action {name} :parameters () :precondition (and {border})\n"
            f"    :effect (and ({verb} ({axis}) 1) (decrease (reward) 0.1)))"
        )
    cells = " ".join(f"(and (= (x) {x}) (= (y) {y}))" for x, y in LAVA)
    lines.append(
        f"  (:event lava :parameters () :precondition (and (or {cells}))\n"
        "    :effect (and (unsafe) (terminal)))"
    )
    lines.append(
        f"  (:event goal :parameters () :precondition (and (= (x) {GOAL[0]}) (= (y) {GOAL[1]}))\n"
        "    :effect (and (terminal) (increase (reward) 10))))"
    )
    return "\n".join(lines)


@functools.cache
def domain() -> Domain:
    """The domain file of the grid, loaded and compiled once."""
    return load_texts(Texts(_text(), None))


def task() -> Task:
    """The task of crossing the grid."""
    return Task(
        make_env=LavaGrid,
        domain=domain(),
        ground=np.asarray,
        reward="environment",
        settings={"*": {"learner": {"hidden": [16], "batch_size": 16}}},
    )
