"""The replay buffer of off-policy learners whose actions are proposals."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer


class ExecutedActionBuffer(ReplayBuffer):
    """Stores the action that was executed, not the one that was proposed.

    A Q-value belongs to the action that led to the next state. In a `serp.GuardedEnv` that is the
    `executed_action` in the info of a step: what the planner did, or what replaced a refused
    proposal. So an off-policy learner learns from the planner's steps as well::

        DQN("MlpPolicy", GuardedEnv("cartpole"), replay_buffer_class=ExecutedActionBuffer)

    It serves all off-policy learners of discrete actions: `DQN`, and `QRDQN` of sb3-contrib.
    """

    def add(
        self,
        obs: NDArray[Any],
        next_obs: NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Store a step; `infos` have an `executed_action` each.

        Raises:
            KeyError: An info has none, so the environment is no `serp.GuardedEnv`.
        """
        executed = np.array([info["executed_action"] for info in infos]).reshape(action.shape)
        super().add(obs, next_obs, executed, reward, done, infos)
