"""Evaluation of a policy in an environment of its own, beside a training."""

from __future__ import annotations

from serp.comparison.trial_records import EvaluationRow
from serp.control.step_record import StepRecord
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judge
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.evaluation import outcome_of
from serp.training.rollout import Decide, Rollout, evaluation_seed


class Arena:
    """An environment of a task in which policies are evaluated, always on the same episodes."""

    def __init__(self, task: Task, agent: Agent, seed: int) -> None:
        self._agent = agent
        self._seed = seed
        self._task = task.bind()
        self._judge = Judge(self._task)

    def close(self) -> None:
        """Close the environment."""
        self._task.close()

    def play(
        self, decide: Decide, episodes: int, *, policy: str, env_steps: int, trained_in: BoundTask
    ) -> list[EvaluationRow]:
        """Play episodes with the running statistics of a training; return their rows in order."""
        statistics = trained_in.environment_state()
        limit, perceive = self._agent.settings.training.episode_steps, self._agent.perceive
        rows = []
        with self._agent.undisturbed():
            for episode in range(episodes):
                self._task.restore_environment(statistics, statistics_only=True)
                seed = evaluation_seed(self._seed, episode)
                rollout = Rollout(self._task, perceive, seed=seed, limit=limit, judge=self._judge)
                *_, last = rollout.steps(decide)
                rows.append(_row(last, episode, policy, env_steps))
        return rows


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
        unsafe_observed=totals.unsafe_observed,
    )
