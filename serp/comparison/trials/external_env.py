"""The environment in which an external algorithm is trained."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.control.step_record import OnStep
from serp.learning.dqn import Proposal
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judge
from serp.training.agent import Agent
from serp.training.rollout import Rollout, training_seed


class ExternalEnv(gym.Env[NDArray[np.float32], np.int64]):
    """A task as a Gymnasium environment, with the protocol of serp's own learner.

    Observations are the learner's input (observation, grounded state or both, by
    `training.inputs`) as float32 `[F]`; the reward is the one that is learned from; episodes
    begin with the same seeds as in serp's training, whatever is given to `reset`; actions are
    0 ... E-1. Nothing is refused; the agent forecasts steps to count unsafe ones.

    Attributes:
        judge: Judges the steps.
        on_step: Called with every env step.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, on_step: OnStep | None = None
    ) -> None:
        self._task = task
        self._agent = agent
        self.judge = Judge(task, agent.settings)
        self.on_step = on_step
        self._seed = seed
        self._episode = 0
        self._rollout: Rollout | None = None
        shape = (agent.learner.input_size,)
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = spaces.Discrete(task.actions.size)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode."""
        rollout = Rollout(
            self._task,
            self._agent.perceive,
            seed=training_seed(self._seed, self._episode),
            limit=self._agent.settings.training.episode_steps,
            judge=self.judge,
        )
        self._episode += 1
        self._rollout = rollout
        return rollout.x.astype(np.float32), rollout.info

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Make an env step."""
        rollout = self._rollout
        if rollout is None or rollout.over:
            raise gym.error.ResetNeeded("reset comes before step")
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is no action of {self.action_space}")
        step = rollout.step(
            self._agent.guarded.execute(rollout.state, Proposal(int(action), False, None))
        )
        if self.on_step is not None:
            self.on_step(step)
        x = step.next_x.astype(np.float32)
        return x, step.reward, step.terminated, step.truncated, step.info
