"""Evaluating a policy: several environments side by side, so that a network sees batches."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp.compare.records import EvaluationRow
from serp.model.transition_model import Vector
from serp.tasks.bound_task import BoundTask
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.evaluation import episode_seed, outcome_of

Act = Callable[[Sequence[Vector], NDArray[np.float64]], Sequence[tuple[int, bool]]]
"""(states, inputs `[B, F]`) → for each the environment action, and whether it is predicted unsafe.
"""

_MOST = 20
"""Environments side by side: more make a network's batch hardly cheaper."""


class Arena:
    """Environments of one task in which policies are evaluated.

    Args:
        task: The task.
        agent: Perceives observations.
        episodes: Episodes of an evaluation at most.
        seed: Seed of the environments: every evaluation plays the same episodes.
    """

    def __init__(self, task: Task, agent: Agent, episodes: int, seed: int) -> None:
        self._agent = agent
        self._seed = seed
        self._stack = contextlib.ExitStack()
        count = min(_MOST, episodes)
        self._tasks = [self._stack.enter_context(task.bind()) for _ in range(count)]

    def close(self) -> None:
        """Close the environments."""
        self._stack.close()

    def play(
        self, act: Act, episodes: int, *, policy: str, env_steps: int, trained_in: BoundTask
    ) -> list[EvaluationRow]:
        """Play episodes and return their rows, in the order of the episodes.

        Args:
            act: The policy.
            episodes: How many.
            policy: Its name.
            env_steps: Env steps of training before.
            trained_in: Where the learner was trained; running statistics are taken from there.
        """
        statistics = trained_in.environment_state()
        for task in self._tasks:
            task.restore_environment(statistics, statistics_only=True)
        rows: list[EvaluationRow | None] = [None] * episodes
        waiting = iter(range(episodes))
        running = [
            _Running(task, k, episode_seed(self._seed, k))
            for task, k in zip(self._tasks, waiting, strict=False)
        ]
        limit = self._agent.settings.training.episode_steps
        while running:
            seen = [self._agent.perceive(one.raw) for one in running]
            inputs = np.stack([x for _, x in seen])
            choices = act([state for state, _ in seen], inputs)
            for one, (action, unsafe) in zip(list(running), choices, strict=True):
                if not one.step(action, unsafe, limit):
                    continue
                rows[one.episode] = one.row(policy, env_steps)
                following = next(waiting, None)
                if following is None:
                    running.remove(one)
                else:
                    one.begin(following, episode_seed(self._seed, following))
        return [row for row in rows if row is not None]


class _Running:
    """An episode that is being played."""

    def __init__(self, task: BoundTask, episode: int, seed: int) -> None:
        self._task = task
        self.begin(episode, seed)

    def begin(self, episode: int, seed: int) -> None:
        self.episode = episode
        self.raw, _ = self._task.reset(seed=seed)
        self._return, self._length, self._unsafe = 0.0, 0, 0
        self._terminated = False
        self._info: dict[str, Any] = {}

    def step(self, action: int, unsafe: bool, limit: int) -> bool:
        """Make a step; return whether the episode is over."""
        self.raw, reward, self._terminated, truncated, self._info = self._task.step(action)
        self._return += reward
        self._length += 1
        self._unsafe += unsafe
        return self._terminated or truncated or self._length >= limit

    def row(self, policy: str, env_steps: int) -> EvaluationRow:
        return EvaluationRow(
            env_steps=env_steps,
            policy=policy,
            episode=self.episode + 1,
            return_=self._return,
            length=self._length,
            terminated=self._terminated,
            outcome=outcome_of(self._info),
            unsafe=self._unsafe,
        )
