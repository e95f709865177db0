"""Rollouts: episodes of an environment, one decision and one step after another."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.agent.step_record import EpisodeTotals, StepRecord
from serp.errors import SettingsError
from serp.tasks.environment import BoundTask
from serp.tasks.remote_task import RemoteTask
from serp.tasks.task import Judge
from serp.tasks.wrapper_state import has_statistics


def training_seed(seed: int, episode: int, use: int = 1) -> int:
    """Return the environment's seed for an episode, from 0, of a training."""
    return int(np.random.SeedSequence(seed, spawn_key=(use, episode)).generate_state(1)[0])


def evaluation_seed(seed: int, episode: int) -> int:
    """Return the environment's seed for an episode, from 0, of an evaluation."""
    return training_seed(seed, episode, use=2)


class Rollout:
    """A running episode of a task, right after the reset of its environment.

    It counts steps and truncates the episode at `training.episode_steps` itself: Gymnasium's
    `TimeLimit` and `RecordEpisodeStatistics` would add layers to the wrapper state of every
    checkpoint, mark terminated steps as truncated, and write into the task's `info`.

    Attributes:
        state: Current state `[F]`.
        x: The learner's input for it.
        info: The environment's info at the reset.
        totals: The totals of the episode so far.
    """

    def __init__(self, task: BoundTask | RemoteTask, agent: Agent, judge: Judge, seed: int) -> None:
        self._task, self._judge, self._take_in = task, judge, agent.take_in
        self._limit = agent.settings.training.episode_steps
        self.totals = EpisodeTotals()
        self._observation, self.info = task.reset(seed=seed)
        self.state, self.x = self._take_in(*task.perceived(self._observation, self.info))
        agent.arbiter.begin_episode()

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
        next_state, next_x = self._take_in(*self._task.perceived(observation, info))
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
            unsafe_observed=judged.unsafe or info.get("unsafe", False),
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


class RolloutEnv:
    """One of the environments of a training, by its index, and the episode that runs in it.

    Attributes:
        episode, seed: Number, from 0, in the order in which episodes begin; seed of its reset.
        random: Whether the episode is a part of the initial data D₀.
    """

    def __init__(self, index: int, task: BoundTask | RemoteTask) -> None:
        self.index, self.task = index, task
        self.episode, self.seed, self.random = 0, 0, False
        self.rollout: Rollout | None = None  # until its reset is done
        self.decision: Decision | None = None  # that is executed next
        self.losses: list[float] = []

    def begin(self, episode: int, seed: int, *, random: bool) -> None:
        """Begin an episode; an environment in another process begins its reset."""
        self.episode, self.seed, self.random = episode, seed, random
        self.rollout, self.decision, self.losses = None, None, []
        if isinstance(self.task, RemoteTask):
            self.task.begin("reset", seed)

    def execute(self, decision: Decision) -> None:
        """Take a decision; an environment in another process begins to execute it."""
        self.decision = decision
        if isinstance(self.task, RemoteTask):
            self.task.begin("step", decision.action)


@contextlib.contextmanager
def rollout_envs(task: BoundTask, count: int) -> Iterator[list[RolloutEnv]]:
    """Yield the environments of a training: that of the task, or `count` in their own processes.

    Raises:
        SettingsError: The environments would normalise differently.
        EnvironmentFailure: An environment cannot be made.
    """
    if count == 1:
        yield [RolloutEnv(0, task)]
        return
    if has_statistics(task.env):
        raise SettingsError(
            f"training.num_envs is {count}, but a wrapper of the environment keeps running "
            "statistics (as NormalizeObservation does). They would differ between environments. "
            "Set training.num_envs to 1, or normalise with fixed numbers"
        )
    with contextlib.ExitStack() as stack:
        tasks = [stack.enter_context(RemoteTask(task, k + 1)) for k in range(count)]
        for remote in tasks:
            remote.wait_until_made()
        yield [RolloutEnv(k, remote) for k, remote in enumerate(tasks)]
