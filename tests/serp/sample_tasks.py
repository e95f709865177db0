"""A small real task to train on: a Gymnasium environment, its domain, and what can go wrong."""

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.tasks.task import Task
from tests.worlds import text

CORRIDOR = text("corridor")

ROBOT = """
import serp
from tests.serp.sample_tasks import Corridor


def ground(seen):
    return {"x": seen[0]}


def walkway() -> serp.Task:
    return serp.Task(
        name="walkway", make_env=Corridor, domain="corridor.pddl", ground=ground
    )
"""
"""A Python file with a task for the corridor."""

SMALL = {
    "planner": {"depth": 2},
    "learner": {
        "hidden": [8],
        "batch_size": 8,
        "buffer_size": 100,
        "learning_starts": 10,
        "epsilon_steps": 60,
    },
}
"""Settings that make a step cheap; the replay memory overflows soon."""


class Corridor(gym.Env[NDArray[np.float64], int]):
    """A noisy walk from the middle of a corridor, with a clock and weather that outlive episodes.

    Actions: left, right, wait, dance (which the domain does not mention). A game lasts 30 ticks of
    the clock, whatever the episodes; a step takes one, and so does a reset. The weather drifts.
    """

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def __init__(self, start=0):
        self.first_action = start
        self.action_space = spaces.Discrete(4, start=start)
        self.x = 0
        self.steps = 0
        self.clock = 0
        self.made = 0
        self.weather = np.random.default_rng(5)
        self.wind = 0.0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.clock += 1
        self.x, self.steps = int(self.np_random.integers(-1, 2)), 0
        return self.seen(), self.info()

    def step(self, action):
        action = int(action - self.first_action)
        self.clock += 1
        self.made += 1
        self.steps += 1
        self.wind = float(self.weather.normal())
        if self.np_random.random() > 0.2:
            self.x += (-1, 1, 0, 0)[action]
        terminated = self.x <= -3 or self.x >= 4
        reward = -0.1 + 0.01 * self.wind + (5.0 * np.sign(self.x) if terminated else 0.0)
        return self.seen(), reward, terminated, self.steps >= 12, self.info()

    def seen(self):
        return np.array([self.x, self.wind])

    def info(self):
        return {"game": self.clock // 30}

    def state_dict(self):
        return {"clock": self.clock, "weather": self.weather.bit_generator.state, "wind": self.wind}

    def load_state_dict(self, state):
        self.clock, self.wind = state["clock"], state["wind"]
        self.weather.bit_generator.state = state["weather"]


class CableCut(gym.Wrapper[NDArray[np.float64], int, NDArray[np.float64], int]):
    """Raises at one step, counted from 1 over all episodes."""

    def __init__(self, env, at):
        super().__init__(env)
        self.left = at

    def step(self, action):
        self.left -= 1
        if self.left == 0:
            raise ConnectionError("cable cut")
        return super().step(action)


def corridor(folder, make_env=Corridor, **changes):
    """The task, with the domain file in a folder.

    Args:
        folder: Where the domain file is written.
        make_env: Another environment.
        changes: Other fields of `Task`.
    """
    file = folder / "corridor.pddl"
    if not file.exists():
        file.write_text(CORRIDOR, encoding="utf-8")
    fields = {
        "make_env": make_env,
        "domain": file,
        "ground": lambda seen: {"x": seen[0]},
        "settings": {"*": SMALL},
    }
    return Task(**{**fields, **changes})


def reckless(agent):
    """Let all actions look alike to the learner: it takes the first, `left`, into the pit."""
    arrays, meta = agent.learner.state_dict()
    arrays["parameters"] = np.zeros_like(arrays["parameters"])
    agent.learner.load_state_dict(arrays, meta)
    return agent
