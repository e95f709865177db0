"""The environment in which the learner of any library acts under planner and arbiter."""

from __future__ import annotations

import contextlib
import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp._util.numbers import seed_of
from serp._util.processes import blas_on_one_thread
from serp._util.terminal import visible
from serp.agent.agent import Agent, account_of
from serp.agent.decision import Actor, Decision
from serp.agent.protocols import Mask, Proposer, Values
from serp.agent.registry import refuse_unknown_names
from serp.agent.step_record import EpisodeTotals, StepRecord
from serp.errors import Notice, SettingsError
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.runs.results import write_results
from serp.runs.rollout import Rollout, evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.run_config import Budget
from serp.runs.run_log import Bookkeeping, RunLog
from serp.settings import resolve
from serp.tasks.environment import BoundTask
from serp.tasks.registry import find_task
from serp.tasks.task import Judge, Task

Answer = tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]
"""What `step` of a Gymnasium environment returns."""


class TaskEnv(gym.Env[NDArray[np.float32], np.int64]):
    """A task as a Gymnasium environment: what an agent perceives, and what it learns from.

    Observations are the learner's input (observation and grounded state) as float32 `[F]`; the
    reward is the one that is learned from; actions are 0 ... E-1. A subclass decides what an
    action of the caller leads to.
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
        self._rollout = rollout = Rollout(self._task, self._agent, self.judge, self.next_seed(seed))
        return rollout.x.astype(np.float32), rollout.info

    def step(self, action: np.int64 | int) -> Answer:
        """Make an env step."""
        rollout = self.running
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is not an action of {self.action_space}")
        step = rollout.step(self.decide(rollout, int(action)))
        info = self.after_step(step)
        return step.next_x.astype(np.float32), step.reward, step.terminated, step.truncated, info

    @property
    def running(self) -> Rollout:
        """The running episode; without any, `ResetNeeded` is raised."""
        if self._rollout is None or self._rollout.over:
            raise gym.error.ResetNeeded("call reset() before step()")
        return self._rollout

    def render(self) -> Any:
        """Return the environment's picture, or draw it in its window."""
        return self._task.env.render()

    def close(self) -> None:
        """Close the environment."""
        self._task.close()


class _Unknown:
    """Stands for a learner whose action is not known yet: proposes any."""

    def propose(self, explorable: Mask | None = None) -> Proposal:
        return Proposal(0, False)

    propose_greedily = propose

    def values(self) -> Values:
        raise SettingsError(
            "guide.strategy: this strategy compares the learner's values, but GuardedEnv does not "
            "know the values of an external learner; choose `learner`, `mixture` or `evidence`"
        )


class ArbitratedEnv(TaskEnv):
    """A task whose actions are proposals: planner, strategy and vetoes decide what is executed.

    The strategy is asked before the action is known, and an action counts only if it is the
    learner's turn. A strategy that compares the learner's values cannot be used. `seed` is that of
    the first sequence of episodes; `reset(seed=s)` begins that of s. `derive` returns the seed of
    the task's environment for one of these and the number of the episode, from 0.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, derive: Callable[[int, int], int]
    ) -> None:
        super().__init__(task, agent)
        self._seed, self._begun = seed, 0
        self._derive = derive
        self._turn: Decision | None = None
        self._last: tuple[Decision, Vector] | None = None

    @abstractmethod
    def ask(self, state: Vector, learner: Proposer) -> Decision:
        """Return the decision in a state for a learner."""

    def action_masks(self) -> NDArray[np.bool_]:
        """Return `[E]` actions that will be executed if they are proposed in the current state.

        On the learner's turn these are the actions that no veto refuses. On the planner's turn, or
        if all are refused, it is the one action that is executed whatever is proposed. A learner
        that draws from the masked actions, like MaskablePPO, therefore always learns from what it
        has chosen itself.

        Raises:
            gymnasium.error.ResetNeeded: No episode is running.
        """
        decision = self._whose_turn(self.running)
        masks = decision.admissible
        if decision.proposed_by is Actor.PLANNER or not masks.any():
            masks = np.arange(len(masks)) == decision.action
        return masks.copy()

    @property
    def last_decision(self) -> Decision | None:
        """The decision of the last step; None before the first one."""
        return None if self._last is None else self._last[0]

    def explain(self) -> str:
        """Return why the last step refused its proposal, quoting the domain file; empty if not."""
        return "" if self._last is None else self._agent.arbiter.explain(*self._last)

    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Return the decision for a proposal."""
        decision = self._whose_turn(rollout)
        self._turn = None
        if decision.proposed_by is not Actor.PLANNER:
            proposal = Proposal(action, False)
            decision = self._agent.arbiter.exchange(decision, rollout.state, proposal)
        self._last = decision, rollout.state
        return decision

    def _whose_turn(self, rollout: Rollout) -> Decision:
        """Return the decision as it is before the learner's action is known."""
        if self._turn is None:
            self._turn = self.ask(rollout.state, _Unknown())
        return self._turn

    def next_seed(self, seed: int | None) -> int:
        """Begin an episode of the sequence, or of another one; return its seed."""
        self._turn = None
        if seed is not None:
            self._seed, self._begun = seed, 0
        self._begun += 1
        return self._derive(self._seed, self._begun - 1)

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Return the task's info with what was executed, by whom and why."""
        decision = step.decision
        return {
            **step.info,
            "executed_action": decision.action,
            "executed_by": str(decision.executed_by),
            "reason": str(decision.reason),
        }


class GuardedEnv(Bookkeeping, ArbitratedEnv):
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
        out: Folder of a run with the metrics, the decisions and, after `close`, the summary. The
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
        seed = seed_of(seed)
        task = find_task(task)
        resolved = resolve(preset, task.settings, settings)
        refuse_unknown_names(resolved, task)
        if resolved.training.num_envs > 1:
            raise SettingsError(
                "training.num_envs: GuardedEnv supports only one environment; set it to 1"
            )
        bound = task.bind(render_mode=render_mode)
        try:
            bound.on_notice = lambda line: warnings.warn(visible(line), Notice, stacklevel=2)
            agent = Agent(bound, resolved, seed)
            if agent.adaptation.notice is not None:
                bound.on_notice(agent.adaptation.notice)
            Bookkeeping.__init__(self)
            ArbitratedEnv.__init__(self, bound, agent, seed, training_seed)
            self._run: Run | None = None
            if out is not None:
                self._run = Run.begin(
                    Path(out), bound, resolved, preset=preset, seed=seed, budget=Budget()
                )
                self.log = RunLog(self._run.path, bound)
        except BaseException:
            bound.close()
            raise
        self._evaluation: contextlib.ExitStack | None = None
        self._initial = resolved.training.random_steps > 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin the next episode; one that is running is truncated, if a step was made in it."""
        rollout = self._rollout
        if rollout is not None and not rollout.over and rollout.totals.length:
            rollout.totals.truncated = True
            self._agent.cut_off()
            self._end_episode(rollout.totals)
        return super().reset(seed=seed, options=options)

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
        self.record_step(step, self.episode + 1)
        with blas_on_one_thread():
            agent.observe(step)
        if step.last:
            self._end_episode(step.episode)
        return super().after_step(step)

    def _end_episode(self, totals: EpisodeTotals) -> None:
        agent = self._agent
        if self._initial:
            self._initial = self.env_steps < agent.settings.training.random_steps
        else:
            agent.strategy.end_episode(totals.return_, totals.length)
        self.record_episode(totals, agent.strategy.rho)

    def evaluation(self, seed: int = 0, *, render_mode: str | None = None) -> EvaluationEnv:
        """Return an environment in which the trained policy is evaluated while training goes on.

        Its episodes are those of a seed; `render_mode` is one of Gymnasium's.
        """
        seed = seed_of(seed)
        return EvaluationEnv(self._task.task.bind(render_mode=render_mode), self, seed)

    def begin_evaluation(self) -> None:
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
        run, log, self._run, self.log = self._run, self.log, None, None
        try:
            if run is not None and log is not None:
                with run, log:
                    log.flush()
                    write_results(run, self.tally.vetoes_by_reason(), account_of(self._agent))
        finally:
            super().close()


class EvaluationEnv(ArbitratedEnv):
    """The arbiter of a `GuardedEnv` in an environment of its own, without learning anything.

    The strategy decides as after training. Proposals should be greedy. The episodes are those of
    `serp evaluate` with the same seed. `task` has an environment of its own.
    """

    def __init__(self, task: BoundTask, training: GuardedEnv, seed: int) -> None:
        super().__init__(task, training._agent, seed, evaluation_seed)
        self._training = training

    def next_seed(self, seed: int | None) -> int:
        """Begin an episode with the running statistics of the training; return its seed."""
        self._training.begin_evaluation()
        trained_in = self._training._task
        self._task.restore_environment(trained_in.environment_state(), statistics_only=True)
        return super().next_seed(seed)

    def ask(self, state: Vector, learner: Proposer) -> Decision:
        """Return the decision in a state, as after training."""
        self._training.begin_evaluation()
        return self._agent.arbiter.decide_greedily(state, learner)
