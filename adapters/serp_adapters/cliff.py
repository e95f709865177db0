"""The slippery cliff task: Gymnasium's cliff walking, each episode ended by a fall."""

from __future__ import annotations

from typing import Any, Final, SupportsFloat, SupportsInt

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

import serp
from serp_adapters.domains import domain_file

COLUMNS: Final = 12
"""Cells of a row; there are four rows."""
START: Final = 36
"""The cell (3, 0)."""
FALL: Final = -100.0
"""Gymnasium's reward of a fall, and of nothing else."""
EPISODE_STEPS: Final = 300
"""Steps after which an episode is cut off: several times what a cautious walk takes."""


class EndAtCliff(gym.Wrapper[int, int, int, int], RecordConstructorArgs):
    """Ends an episode when the robot falls, and returns the cell of the cliff.

    Gymnasium's `CliffWalkingEnv` moves a robot that falls back to the start and continues the
    episode. Here a fall terminates the episode, and the observation is the cell of the cliff. The
    robot's last cell determines it: above the cliff the robot falls straight down, from the start
    it falls to the right.

    The info has `falls`: the number of falls in this episode, 0 or 1.
    """

    def __init__(self, env: gym.Env[int, int]) -> None:
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        self._cell = START

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[int, dict[str, Any]]:
        """Start an episode; see `gymnasium.Env.reset`."""
        cell, info = self.env.reset(seed=seed, options=options)
        self._cell = int(cell)
        return self._cell, {**info, "falls": 0}

    def step(self, action: int) -> tuple[int, SupportsFloat, bool, bool, dict[str, Any]]:
        """Move; see `gymnasium.Env.step`.

        Returns:
            The cell, row · 12 + column, that of the cliff after a fall; Gymnasium's reward; whether
            the robot fell or is at the goal (terminated); truncated; the info.
        """
        cell, reward, terminated, truncated, info = self.env.step(action)
        fell = float(reward) == FALL
        if fell:
            cell = self._cell + (1 if self._cell == START else COLUMNS)
        self._cell = int(cell)
        return self._cell, reward, terminated or fell, truncated, {**info, "falls": int(fell)}


def make_env(**options: Any) -> gym.Env[Any, Any]:
    """Return the environment; options are those of Gymnasium's `CliffWalkingEnv`."""
    made = gym.make("CliffWalkingSlippery-v1", max_episode_steps=EPISODE_STEPS, **options)
    return EndAtCliff(made)


def ground(observation: SupportsInt) -> NDArray[np.float64]:
    """Return row (0 to 3, from above) and column (0 to 11, from the left) of a cell (0 to 47)."""
    return np.array(divmod(int(observation), COLUMNS), dtype=np.float64)


def task() -> serp.Task:
    """Return the task."""
    return serp.Task(
        name="cliff",
        make_env=make_env,
        domain=domain_file("cliff"),
        ground=ground,
        actions={"up": 0, "right": 1, "down": 2, "left": 3},
        # A fall costs more than any step, so this threshold refuses falls alone.
        settings={"*": {"arbiter": {"r_min": -15.0}}},
        counters=("falls",),
        description="cross an icy plateau without slipping over its edge",
    )
