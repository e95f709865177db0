"""A task as a Gymnasium environment with flat observations and numbered actions."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.control.decision import Decision
from serp.control.step_record import StepRecord
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judge
from serp.training.agent import Agent
from serp.training.rollout import Rollout

Answer = tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]
"""What `step` of a Gymnasium environment returns."""


class TaskEnv(gym.Env[NDArray[np.float32], np.int64]):
    """A task as a Gymnasium environment: what an agent perceives, and what it learns from.

    Observations are the learner's input (observation, grounded state or both, by
    `training.inputs`) as float32 `[F]`; the reward is the one that is learned from; actions are
    0 ... E-1. A subclass decides what an action of the caller leads to.

    Attributes:
        judge: Judges the steps.
    """

    def __init__(self, task: BoundTask, agent: Agent) -> None:
        self._task = task
        self._agent = agent
        self._rollout: Rollout | None = None
        self.metadata, self.render_mode = task.env.metadata, task.env.render_mode
        self.judge = Judge(task, agent.settings)
        shape = (agent.learner.input_size,)
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = spaces.Discrete(task.actions.size)

    @abstractmethod
    def next_seed(self, seed: int | None) -> int:
        """Return the environment's seed for the next episode, given what `reset` got."""

    @abstractmethod
    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Return the decision for the caller's action."""

    @abstractmethod
    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Handle an env step; return the info for the caller."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode."""
        super().reset(seed=seed)
        self._rollout = rollout = Rollout(
            self._task,
            self._agent.perceive,
            seed=self.next_seed(seed),
            limit=self._agent.settings.training.episode_steps,
            judge=self.judge,
        )
        return rollout.x.astype(np.float32), rollout.info

    def step(self, action: np.int64 | int) -> Answer:
        """Make an env step."""
        rollout = self.running
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is no action of {self.action_space}")
        step = rollout.step(self.decide(rollout, int(action)))
        info = self.after_step(step)
        return step.next_x.astype(np.float32), step.reward, step.terminated, step.truncated, info

    @property
    def running(self) -> Rollout:
        """The running episode.

        Raises:
            gymnasium.error.ResetNeeded: There is none.
        """
        if self._rollout is None or self._rollout.over:
            raise gym.error.ResetNeeded("reset comes before step")
        return self._rollout

    def render(self) -> Any:
        """Return the environment's picture, or draw it in its window."""
        return self._task.env.render()

    def close(self) -> None:
        """Close the environment."""
        self._task.close()
