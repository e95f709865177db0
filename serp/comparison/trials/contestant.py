"""Contestants: algorithms in training, in the form that a trial uses."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from serp.comparison.algorithms import Algorithm
from serp.comparison.trials.characteristics import REWARDS, characteristics_of
from serp.comparison.trials.external_env import ExternalEnv
from serp.control.decision import Decision
from serp.control.step_record import OnStep
from serp.errors import RunError, SerpError
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.trainer import Trainer


class Contestant(Protocol):
    """An algorithm with a task and a seed.

    Attributes:
        agent: Converts observations; its guarded arbiter has the vetoes.
        characteristics: Name → text, for the report's table of differences.
    """

    agent: Agent
    characteristics: Mapping[str, str]

    def train(self, env_steps: int, on_step: OnStep) -> None:
        """Train for at least this number of env steps, unless `on_step` raises."""

    def greedy(self, state: Vector, x: Vector) -> int:
        """Return the learner's greedy action, without planner and veto."""

    def vetoed(self, state: Vector, x: Vector) -> Decision:
        """Decide greedily within the vetoes."""


def make_contestant(
    algorithm: Algorithm, task: BoundTask, settings: Settings, seed: int
) -> Contestant:
    """Return an algorithm, ready to be trained in a task's environment."""
    if algorithm.make_external is not None:
        return _External(algorithm, task, Agent(task, settings, seed), seed)
    return _Own(algorithm, task, settings, seed)


class _Own:
    """A contestant that `Trainer` trains."""

    def __init__(
        self, algorithm: Algorithm, task: BoundTask, settings: Settings, seed: int
    ) -> None:
        self.agent = Agent(task, settings, seed, baseline=algorithm.kind == "baseline")
        self._trainer = Trainer(task, settings, seed, agent=self.agent)
        self._trainer.prepare()  # loading compiled code does not count as training
        self.characteristics: Mapping[str, str] = characteristics_of(
            algorithm, settings, self._trainer.judge.source
        )

    def train(self, env_steps: int, on_step: OnStep) -> None:
        self._trainer.on_step = on_step
        while self._trainer.env_steps < env_steps:
            self._trainer.run_episode()

    def greedy(self, state: Vector, x: Vector) -> int:
        return self.agent.learner.propose_greedily(x).action

    def vetoed(self, state: Vector, x: Vector) -> Decision:
        return self.agent.guarded.decide_greedily(state, self.agent.proposer(x))


class _External:
    """An external algorithm, which trains itself in the environment that it is given."""

    def __init__(self, algorithm: Algorithm, task: BoundTask, agent: Agent, seed: int) -> None:
        self.agent = agent
        self._env = ExternalEnv(task, agent, seed)
        assert algorithm.make_external is not None
        self._name = algorithm.name
        with self._blamed():
            self._algorithm = algorithm.make_external(self._env, task.name, seed)
        self.characteristics: Mapping[str, str] = {
            "learned from": REWARDS[self._env.judge.source],
            **self._algorithm.characteristics,
        }

    def train(self, env_steps: int, on_step: OnStep) -> None:
        self._env.on_step = on_step
        with self._blamed():
            self._algorithm.learn(env_steps)

    def greedy(self, state: Vector, x: Vector) -> int:
        with self._blamed():
            one = x[np.newaxis].astype(np.float32)
            actions: NDArray[Any] = np.asarray(self._algorithm.act(one))
            size = self.agent.learner.action_count
            whole = actions.dtype.kind in "iu" and actions.shape == (1,)
            if not whole or not 0 <= actions[0] < size:
                raise ValueError(
                    f"act returned {actions!r}; one whole number 0 ... {size - 1} is wanted"
                )
            return int(actions[0])

    @contextlib.contextmanager
    def _blamed(self) -> Iterator[None]:
        """Raise a RunError that names the algorithm for any exception of it."""
        try:
            yield
        except SerpError:
            raise
        except Exception as error:
            raise RunError(f"`{self._name}` failed: {type(error).__name__}: {error}") from error

    def vetoed(self, state: Vector, x: Vector) -> Decision:
        proposal = Proposal(self.greedy(state, x), False, None)
        return self.agent.guarded.judge_proposal(state, proposal)
