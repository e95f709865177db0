"""The environment that an algorithm from outside is trained in: our task, seen from outside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.compare.trials.baseline import Unguarded
from serp.control.arbiter import Decision
from serp.model.transition_model import Vector
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judge
from serp.training.agent import Agent
from serp.training.trainer import Transition, episode_seed


class Fixed:
    """A proposal that stands already, whoever made it."""

    exploratory = False
    q = None

    def __init__(self, action: int) -> None:
        self.action = action

    def __repr__(self) -> str:
        return f"Fixed({self.action})"


class ExternalEnv(gym.Env[NDArray[np.float32], np.int64]):
    """A task as a plain environment, on the terms that our own learner has.

    Observations are the learner's input (observation, grounded state or both, as
    `training.inputs` says) as float32 `[F]`; the reward is the one that is learned from; episodes
    begin with the same seeds as in our own training; actions are 0 ... E-1. Nothing is refused.

    Args:
        task: The task.
        agent: Perceives, and forecasts what is predicted unsafe.
        seed: Seed of the training; a seed given to `reset` is ignored.
        on_step: Called with every env step.

    Attributes:
        judge: Says what a step is worth.
    """

    def __init__(
        self,
        task: BoundTask,
        agent: Agent,
        seed: int,
        on_step: Callable[[Transition], None],
    ) -> None:
        self._task = task
        self._agent = agent
        self.judge = Judge(task, agent.settings)
        self._unguarded = Unguarded(
            agent.arbiter.planner, task.actions, agent.settings.arbiter, agent.arbiter.strategy
        )
        self._seed = seed
        self._on_step = on_step
        self._episode = 0
        self._length = 0
        self._state: Vector | None = None
        shape = (agent.learner.input_size,)
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = spaces.Discrete(task.actions.size)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode."""
        raw, info = self._task.reset(seed=episode_seed(self._seed, self._episode))
        self._episode += 1
        self._length = 0
        self._state, x = self._agent.perceive(raw)
        return x.astype(np.float32), info

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Make an env step."""
        state = self._state
        if state is None:
            raise gym.error.ResetNeeded("reset comes before step")
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is no action of {self.action_space}")
        decision: Decision = self._unguarded.judge_proposal(state, Fixed(int(action)))
        raw, env_reward, terminated, truncated, info = self._task.step(decision.action)
        next_state, x = self._agent.perceive(raw)
        ground = int(decision.forecast.ground[decision.action])
        reward = self.judge(state, ground, next_state, env_reward).reward
        self._length += 1
        limit = self._agent.settings.training.episode_steps
        truncated = truncated or (self._length >= limit and not terminated)
        self._state = None if terminated or truncated else next_state
        self._on_step(Transition(decision, reward, env_reward, terminated, truncated, info))
        return x.astype(np.float32), reward, terminated, truncated, info
