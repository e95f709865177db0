"""Generated worlds to train in: an environment that does what a domain says, with some noise."""

from __future__ import annotations

import functools
from random import Random
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.loading import Domain
from serp.model.transition_model import TransitionModel
from serp.tasks.task import Task
from tests.generated import Texts, load_texts
from tests.serp.planning.worlds import text_of

STEPS = 15
"""An episode is cut after so many."""


class Imagined(gym.Env[NDArray[np.float64], np.int64]):
    """Does what the model predicts; now and then something else happens.

    The last action is one that the domain does not mention: nothing happens.
    """

    def __init__(self, model: TransitionModel) -> None:
        self.model = model
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(model.fluents),), np.float64)
        self.action_space = spaces.Discrete(len(model.actions) + 1)
        self.state: list[float] = []
        self.steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        super().reset(seed=seed)
        self.state, self.steps = self._anywhere(), 0
        return np.array(self.state), {}

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        self.steps += 1
        reward, flags = 0.0, 0
        if action < len(self.model.actions):
            out, flags = self.model.transition(self.state, int(action))
            if flags & APPLICABLE and not flags & UNDEFINED and max(map(abs, out)) < 100.0:
                *self.state, reward = out
        if self.np_random.random() < 0.2:
            self.state = self._anywhere()
        ended = bool(flags & TERMINAL)
        return np.array(self.state), float(reward), ended, self.steps >= STEPS, {}

    def _anywhere(self) -> list[float]:
        draw = self.np_random.integers
        return [float(draw(-4, 5)) / 2 if f.numeric else float(draw(2)) for f in self.model.fluents]


@functools.cache
def domain(seed: int) -> Domain:
    """Return the generated domain of a seed; its model is compiled once."""
    return load_texts(Texts(text_of(seed), None))


def imagined(seed: int) -> Task:
    """Return the task of training in a generated world."""
    found = domain(seed)
    random = Random(seed)
    return Task(
        make_env=lambda: Imagined(found.model),
        domain=found,
        ground=np.asarray,
        reward="environment",
        settings={
            "*": {
                "planner": {"depth": random.randint(1, 3), "repeat": random.choice((1, 2))},
                "learner": {
                    "hidden": [8],
                    "batch_size": 8,
                    "buffer_size": 100,
                    "learning_starts": 10,
                    "protected_early": 10,
                    "protected_failing": 10,
                    "epsilon_start": 0.5,
                    "epsilon_end": 0.2,
                },
            }
        },
    )
