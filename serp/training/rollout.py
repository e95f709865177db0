"""Rollouts: the only place where a task's environment is stepped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import gymnasium as gym
import numpy as np

from serp.control.decision import Decision
from serp.control.step_record import EpisodeTotals, StepRecord
from serp.model.transition_model import Vector
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judge, Judged

_TRAINING: Final = 1
_EVALUATION: Final = 2
"""Spawn keys of the environment's seeds."""

Perceive = Callable[[Any, Mapping[str, Any], gym.Env[Any, Any]], tuple[Vector, Vector]]
"""(observation, info, environment that gave them) → (state, input of the learner)."""
Decide = Callable[[Vector, Vector], Decision]
"""(state, input of the learner) → decision."""


def training_seed(seed: int, episode: int) -> int:
    """Return the environment's seed for an episode, from 0, of a training."""
    return _seed(seed, _TRAINING, episode)


def evaluation_seed(seed: int, episode: int) -> int:
    """Return the environment's seed for an episode, from 0, of an evaluation."""
    return _seed(seed, _EVALUATION, episode)


def _seed(seed: int, use: int, episode: int) -> int:
    return int(np.random.SeedSequence(seed, spawn_key=(use, episode)).generate_state(1)[0])


class Rollout:
    """A running episode of a task, right after the reset of its environment.

    It counts steps and truncates the episode after `limit` itself: Gymnasium's `TimeLimit` and
    `RecordEpisodeStatistics` would add layers to the wrapper state of every checkpoint, mark
    terminated steps as truncated, and write into `info`, which belongs to the task. Without a
    judge, only the environment's reward is used.

    Attributes:
        state: Current state `[F]`.
        x: The learner's input for it.
        info: The environment's info at the reset.
        totals: The totals of the episode so far.
    """

    def __init__(
        self,
        task: BoundTask,
        perceive: Perceive,
        *,
        seed: int,
        limit: int,
        judge: Judge | None = None,
    ) -> None:
        self._task = task
        self._perceive = perceive
        self._limit = limit
        self._judge = judge
        self.totals = EpisodeTotals()
        self._observation, self.info = task.reset(seed=seed)
        self.state, self.x = perceive(self._observation, self.info, task.env)

    @property
    def over(self) -> bool:
        """Whether the episode has ended."""
        return self.totals.terminated or self.totals.truncated

    def step(self, decision: Decision) -> StepRecord:
        """Execute a decision and return the record of the step.

        Raises:
            EnvironmentFailure: The environment raised or gave NaN.
            TaskError: The grounding failed.
            StateError: The domain file cannot judge the step, and its reward is learned from.
        """
        observation, env_reward, terminated, truncated, info = self._task.step(decision.action)
        next_state, next_x = self._perceive(observation, info, self._task.env)
        if self._judge is None:
            judged = Judged(env_reward, 0.0, False)
        else:
            ground = int(decision.forecast.ground[decision.action])
            judged = self._judge(self.state, ground, next_state, env_reward)
        number = self.totals.length + 1
        record = StepRecord(
            number=number,
            observation=self._observation,
            state=self.state,
            x=self.x,
            decision=decision,
            reward=judged.reward,
            domain_reward=judged.domain_reward,
            env_reward=env_reward,
            unsafe=judged.unsafe,
            next_state=next_state,
            next_x=next_x,
            terminated=terminated,
            truncated=truncated or (number >= self._limit and not terminated),
            info=info,
            episode=self.totals,
        )
        self.totals.add(record)
        self._observation, self.state, self.x = observation, next_state, next_x
        return record

    def steps(self, decide: Decide) -> Iterator[StepRecord]:
        """Yield the steps of a policy to the end of the episode; each is executed when needed."""
        while not self.over:
            yield self.step(decide(self.state, self.x))
