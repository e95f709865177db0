"""Evaluation of a policy in several environments at once, so that networks compute batches."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from serp.comparison.trial_records import EvaluationRow
from serp.control.decision import Decision
from serp.control.step_record import StepRecord
from serp.model.transition_model import Vector
from serp.tasks.bound_task import BoundTask
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.evaluation import outcome_of
from serp.training.rollout import Rollout, evaluation_seed

Act = Callable[[Sequence[Vector], NDArray[np.float64]], Sequence[Decision]]
"""(states, inputs `[B, F]`) → a decision for each."""

_MOST = 20
"""Number of environments; larger batches are hardly faster."""


class Arena:
    """Environments of one task in which policies are evaluated, always on the same episodes."""

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
        """Play episodes with the running statistics of a training; return their rows in order."""
        statistics = trained_in.environment_state()
        for task in self._tasks:
            task.restore_environment(statistics, statistics_only=True)
        lasts: dict[int, StepRecord] = {}
        waiting = iter(range(episodes))
        running = [
            (task, k, self._begin(task, k)) for task, k in zip(self._tasks, waiting, strict=False)
        ]
        while running:
            inputs = np.stack([rollout.x for _, _, rollout in running])
            decisions = act([rollout.state for _, _, rollout in running], inputs)
            ongoing = []
            for (task, episode, rollout), decision in zip(running, decisions, strict=True):
                step = rollout.step(decision)
                if not step.last:
                    ongoing.append((task, episode, rollout))
                    continue
                lasts[episode] = step
                following = next(waiting, None)
                if following is not None:
                    ongoing.append((task, following, self._begin(task, following)))
            running = ongoing
        return [_row(lasts[k], k, policy, env_steps) for k in range(episodes)]

    def _begin(self, task: BoundTask, episode: int) -> Rollout:
        limit = self._agent.settings.training.episode_steps
        seed = evaluation_seed(self._seed, episode)
        return Rollout(task, self._agent.perceive, seed=seed, limit=limit)


def _row(last: StepRecord, episode: int, policy: str, env_steps: int) -> EvaluationRow:
    totals = last.episode
    return EvaluationRow(
        env_steps=env_steps,
        policy=policy,
        episode=episode + 1,
        return_=totals.return_,
        length=totals.length,
        terminated=totals.terminated,
        outcome=outcome_of(last.info),
        unsafe=totals.decisions.unsafe_executed,
    )
