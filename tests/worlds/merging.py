"""Merging onto a road: a car at the end of its ramp, and two others, whose drivers have moods."""

from pathlib import Path

import gymnasium as gym
import numpy as np

from serp.tasks.task import Task

PERIOD, END, LENGTH, ROOM = 0.5, 120.0, 200.0, 6.0


class Merging(gym.Env):
    """Observations are x, speed, merged, and distance and speed of the cars ahead and behind.

    The drivers of the others accelerate by chance, which the file does not know. A crash ends the
    episode with a reward of -2, and arriving with 2.
    """

    def __init__(self):
        self.observation_space = gym.spaces.Box(-1e3, 1e3, (7,), np.float64)
        self.action_space = gym.spaces.Discrete(4)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        draw = self.np_random.uniform
        ahead = draw(-20.0, 40.0)
        self._x, self._speed, self._merged, self._steps = 0.0, draw(14.0, 22.0), False, 0
        self._others = np.array([ahead, ahead - draw(25.0, 60.0)])  # on the lane
        self._speeds = draw(14.0, 22.0, 2)
        return self._seen(), {}

    def _seen(self):
        (ahead, behind), (fast, slow) = self._others - self._x, self._speeds
        return np.array([self._x, self._speed, self._merged, ahead, fast, behind, slow])

    def step(self, action):
        faster = 1.5 if self._speed < 30.0 else 0.0
        self._speed = max(0.0, self._speed + {0: -2.0, 2: faster}.get(int(action), 0.0))
        self._merged |= action == 3
        self._steps += 1
        self._speeds = np.clip(self._speeds + self.np_random.normal(0.0, 0.4, 2), 8.0, 28.0)
        self._x += PERIOD * self._speed
        self._others = self._others + PERIOD * self._speeds
        gaps = np.abs(self._others - self._x)
        crash = bool(gaps.min() < ROOM) if self._merged else self._x > END
        done = self._merged and self._x > LENGTH and not crash
        reward = -0.02 + (2.0 if done else -2.0 if crash else 0.0)
        return self._seen(), reward, crash or done, self._steps >= 150, {"unsafe": crash}


def ground(observation):
    """Observation → fluents."""
    names = ("x", "speed", "merged", "ahead", "ahead-speed", "behind", "behind-speed")
    return dict(zip(names, observation.tolist(), strict=True)) | {"merged": observation[2] > 0.5}


def merging_task():
    """The task, whose rewards are the environment's."""
    file = Path(__file__).with_suffix(".pddl")
    return Task(
        name="merging", make_env=Merging, domain=file, ground=ground, dt=PERIOD,
        reward="environment",
    )  # fmt: skip
