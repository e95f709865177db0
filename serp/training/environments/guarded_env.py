"""The environment in which the learner of any library acts under planner and arbiter."""

from __future__ import annotations

import contextlib
import datetime
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import seed_of
from serp._util.terminal import visible
from serp._util.threads import blas_on_one_thread
from serp.control.decision import Decision
from serp.control.protocols import Proposer
from serp.control.registry import refuse_unknown_names
from serp.control.step_record import EpisodeTotals, StepRecord
from serp.errors import Notice, SettingsError
from serp.model.transition_model import Vector
from serp.settings import resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.registry import find_task
from serp.tasks.task import Task
from serp.training.agent import Agent
from serp.training.environments.arbitrated_env import ArbitratedEnv
from serp.training.environments.run_log import RunLog
from serp.training.rollout import Lane, evaluation_seed, training_seed


class GuardedEnv(ArbitratedEnv):
    """A task for the training loop of any library, with planner, strategy and vetoes inside.

    An action is the learner's *proposal*. What is executed, the arbiter decides as in
    `serp.plan_and_learn`: with the same guarantee, strategies, presets and adaptation of the model,
    which goes on with every step. Observations are the learner's input as float32 `[F]`, rewards
    the ones that are learned from. The info of a step says what was executed, by whom and why:
    ``executed_action``, ``executed_by`` and ``reason``. An off-policy learner has to remember the
    executed action.

    Of the settings, those of the section `learner` do not count, but for `learning_starts`: the
    strategy `evidence` gives the learner no lead before. In the first `training.random_steps` env
    steps it is always the learner's turn.

    `reset(seed=s)` begins the sequence of episodes of seed s; without a seed the next episode of
    the sequence begins. A reset in the middle of an episode truncates it, so that a wrapper like
    `TimeLimit` may be around the environment. An environment has an arbiter and a model of its own,
    so a learner uses one at a time.

    Args:
        task: The task, the name of an installed one, or a domain file that belongs to one.
        preset: `default` or `paper`.
        settings: Section → setting → value; overrides preset and task.
        seed: Seed of everything random in it, and of the first sequence of episodes.
        out: Folder of a run with the metrics, the decisions and, after `close`, the report. The
            learner itself is saved by its library. By default nothing is written.
        render_mode: One of Gymnasium's render modes, if pictures are needed.

    Attributes:
        env_steps, episode: Numbers of env steps and of complete episodes.

    Raises:
        SerpError: Task, domain, settings or folder are wrong.
    """

    def __init__(
        self,
        task: Task | str,
        *,
        preset: str = "default",
        settings: Mapping[str, Mapping[str, Any]] | None = None,
        seed: int = 0,
        out: str | Path | None = None,
        render_mode: str | None = None,
    ) -> None:
        begun = datetime.datetime.now()
        seed = seed_of(seed)
        task = find_task(task) if isinstance(task, str) else task
        resolved = resolve(preset, task.settings, settings)
        refuse_unknown_names(resolved, task.planners)
        if resolved.training.num_envs > 1:
            raise SettingsError("training.num_envs: a guarded environment is one; set it to 1")
        bound = task.bind(render_mode=render_mode)
        try:
            bound.on_notice = lambda line: warnings.warn(visible(line), Notice, stacklevel=2)
            agent = Agent(bound, resolved, seed)
            if agent.adaptation.notice is not None:
                bound.on_notice(agent.adaptation.notice)
            super().__init__(bound, agent, seed, training_seed)
            self._log = RunLog(bound, resolved, preset, seed, out, begun)
        except BaseException:
            bound.close()
            raise
        self._lane = Lane(0, bound)
        self._evaluation: contextlib.ExitStack | None = None
        self.env_steps = self.episode = 0
        self._initial = resolved.training.random_steps > 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode; one that is running is truncated."""
        self._cut_off()
        x, info = super().reset(seed=seed, options=options)
        self._notice_unit(info, reset=True)
        return x, info

    def ask(self, state: Vector, learner: Proposer) -> Decision:
        """Return the decision in a state, as in training."""
        self._end_evaluation()
        arbiter = self._agent.arbiter
        if self._initial:
            return arbiter.judge_proposal(state, learner.propose(None))
        return arbiter.decide(state, learner)

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Adapt the model, count, log, and return the task's info with the decision."""
        agent = self._agent
        self._log.step(step, agent.arbiter, self.env_steps, self.episode + 1)
        with blas_on_one_thread():
            agent.observe(step)
        self.env_steps += 1
        if not self._initial:
            agent.strategy.end_unit("step")
        self._notice_unit(step.info)
        if step.last:
            self._end_episode(step.episode)
        return super().after_step(step)

    def _cut_off(self) -> None:
        """Truncate the running episode, if a step was made in it."""
        rollout = self._rollout
        if rollout is not None and not rollout.over and rollout.totals.length:
            rollout.cut_off()
            self._agent.cut_off()
            self._end_episode(rollout.totals)

    def _notice_unit(self, info: Mapping[str, Any], *, reset: bool = False) -> None:
        unit = self._agent.settings.arbiter.rho_unit
        if self._lane.unit_ended(unit, info, reset=reset) and not self._initial:
            self._agent.strategy.end_unit(unit)

    def _end_episode(self, totals: EpisodeTotals) -> None:
        self.episode += 1
        agent = self._agent
        if self._initial:
            self._initial = self.env_steps < agent.settings.training.random_steps
        else:
            agent.strategy.end_unit("episode")
            agent.strategy.end_episode(totals.return_, totals.length)
        self._log.episode(totals, agent.strategy.rho, self.env_steps, self.episode)

    def evaluation(self, seed: int = 0, *, render_mode: str | None = None) -> EvaluationEnv:
        """Return an environment in which the trained policy is evaluated while training goes on.

        Args:
            seed: Seed of its episodes.
            render_mode: One of Gymnasium's render modes, if pictures are needed.
        """
        bound = self._task.task.bind(render_mode=render_mode)
        return EvaluationEnv(bound, self._agent, seed_of(seed), self._task, self._begin_evaluation)

    def _begin_evaluation(self) -> None:
        """Let what the planner keeps from now on be forgotten at the training's next decision."""
        if self._evaluation is None:
            self._evaluation = contextlib.ExitStack()
            self._evaluation.enter_context(self._agent.undisturbed())

    def _end_evaluation(self) -> None:
        if self._evaluation is not None:
            self._evaluation.close()
            self._evaluation = None

    def close(self) -> None:
        """Close the environment, and write the results of the run."""
        self._log.close(self._agent)
        super().close()


class EvaluationEnv(ArbitratedEnv):
    """The arbiter of a `GuardedEnv` in an environment of its own, without learning anything.

    The strategy decides as after training. Proposals should be greedy. The episodes are those of
    `serp evaluate` with the same seed.

    Args:
        task: The task, with an environment of its own.
        agent: The agent in training.
        seed: Seed of the episodes.
        trained_in: The task in which it is trained.
        begin: Called before each decision; from the first one on, the planner keeps what it finds
            for the evaluation alone.
    """

    def __init__(
        self,
        task: BoundTask,
        agent: Agent,
        seed: int,
        trained_in: BoundTask,
        begin: Callable[[], None],
    ) -> None:
        super().__init__(task, agent, seed, evaluation_seed)
        self._trained_in, self._begin = trained_in, begin

    def next_seed(self, seed: int | None) -> int:
        """Begin an episode with the running statistics of the training; return its seed."""
        self._task.restore_environment(self._trained_in.environment_state(), statistics_only=True)
        return super().next_seed(seed)

    def ask(self, state: Vector, learner: Proposer) -> Decision:
        """Return the decision in a state, as after training."""
        self._begin()
        return self._agent.arbiter.decide_greedily(state, learner)
