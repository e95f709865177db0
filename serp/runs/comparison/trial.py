"""One trial: train one algorithm with one seed on one domain file, and measure it."""

from __future__ import annotations

import contextlib
import platform
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import working_time
from serp._util.numbers import real
from serp._util.processes import one_thread
from serp._util.terminal import visible
from serp.agent.agent import Agent
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import OnStep, StepRecord
from serp.errors import Notice, RunError, SerpError, TaskError
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE
from serp.runs.comparison.algorithms import REWARDS, Algorithm, characteristics_of
from serp.runs.comparison.plan import ComparisonProtocol, EpisodeRow, EvaluationRow
from serp.runs.evaluation import outcome_of
from serp.runs.folder import versions
from serp.runs.guarded_env import TaskEnv
from serp.runs.rollout import (
    SLOW_STEP_SECONDS,
    Decide,
    Rollout,
    Watchdog,
    evaluation_seed,
    training_seed,
)
from serp.runs.trainer import Trainer
from serp.settings import Settings
from serp.tasks.action_map import ActionForecast
from serp.tasks.environment import single
from serp.tasks.task import BoundTask, Judge, Task


class Log:
    """Collects the rows of the episodes of one training.

    Args:
        counters: Names of the counters that are logged as `info.<name>`.
        clock: Monotonic clock, seconds; by default without compilation.

    Attributes:
        counters: As given.
        env_steps: Env steps so far.
        rows: For each complete episode an `EpisodeRow` and the value of each counter.
        pauses: Seconds that were not training.
    """

    def __init__(
        self,
        counters: Sequence[str],
        clock: Callable[[], float] = working_time,
    ) -> None:
        self.counters = tuple(counters)
        self._clock = clock
        self._begin = clock()
        self.pauses = 0.0
        self.env_steps = 0
        self.rows: list[tuple[EpisodeRow, tuple[float, ...]]] = []

    @property
    def seconds(self) -> float:
        """Seconds of training."""
        return self._clock() - self._begin - self.pauses

    @contextmanager
    def paused(self) -> Any:
        """Exclude the body from the time of training."""
        begin = self._clock()
        try:
            yield
        finally:
            self.pauses += self._clock() - begin

    def step(self, step: StepRecord) -> None:
        """Log an env step."""
        self.env_steps += 1
        if step.last:
            self._end_episode(step)

    def _end_episode(self, last: StepRecord) -> None:
        info, totals = last.info, last.episode
        counts = totals.decisions.numbers()
        row = EpisodeRow(
            episode=len(self.rows) + 1,
            env_steps=self.env_steps,
            return_=totals.return_,
            learner_return=totals.learner_return,
            length=totals.length,
            terminated=totals.terminated,
            outcome=outcome_of(info),
            unsafe=counts["unsafe_executed"],
            avoidable_unsafe=totals.avoidable_unsafe,
            unsafe_observed=totals.unsafe_observed,
            vetoes=counts["vetoes"],
            planner_steps=counts["planner_steps"],
            seconds=self.seconds,
        )
        self.rows.append((row, tuple(_counted(info, name) for name in self.counters)))


def _counted(info: dict[str, Any], name: str) -> float:
    found = single(info.get(name, 0))
    value = real(int(found) if isinstance(found, bool) else found)
    if value is None:
        raise TaskError(
            f"the task counts `{name}`, but the environment's info has {info[name]!r} there; a "
            "finite number is wanted"
        )
    return float(value)


class ExternalEnv(TaskEnv):
    """A task as a Gymnasium environment, with the protocol of serp's own learner.

    Episodes begin with the same seeds as in serp's training, whatever is given to `reset`. Nothing
    is refused; the agent forecasts steps to count unsafe ones.

    Attributes:
        on_step: Called with every env step.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, on_step: OnStep | None = None
    ) -> None:
        super().__init__(task, agent)
        self.on_step = on_step
        self._seed = seed
        self._episode = 0

    def next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode of serp's training."""
        self._episode += 1
        return training_seed(self._seed, self._episode - 1)

    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Execute the action, whatever it is."""
        return self._agent.guarded.execute(rollout.state, Proposal(action, False, None))

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Report the step; the info is the task's."""
        if self.on_step is not None:
            self.on_step(step)
        return step.info


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
        self._trainer = Trainer(task, settings, seed, baseline=algorithm.kind == "baseline")
        self.agent = self._trainer.agent
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
                self._agent.arbiter.begin_episode()
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


class _Spent(BaseException):
    """The budget is spent; this interrupts the training in the middle of an episode.

    No `Exception`, which an external algorithm might handle.
    """


@dataclass(frozen=True)
class Measured:
    """The results of a trial.

    Attributes:
        log: The log of its training.
        evaluations: The episodes of all evaluations.
        characteristics: Name → text.
        seconds: `training` and `evaluation` → their wall time.
        versions: Package → version of what ran the trial, Python included.
        lead: JSON values on who leads after training: `rho`, and the `evidence` of the strategy, if
            it goes by any; None for algorithms without planner or learner.
    """

    log: Log
    evaluations: list[EvaluationRow]
    characteristics: dict[str, str]
    seconds: dict[str, float]
    versions: dict[str, str | None]
    lead: dict[str, Any] | None


def run_trial(
    algorithm: Algorithm,
    task: Task,
    settings: Settings,
    seed: int,
    protocol: ComparisonProtocol,
    on_progress: Callable[[int], None],
) -> Measured:
    """Train and measure; `on_progress` gets the env steps so far, a few times per second."""
    with one_thread(), task.bind() as bound:
        contestant = make_contestant(algorithm, bound, settings, seed)
        return _Trial(algorithm, contestant, bound, protocol, on_progress).run()


class _Trial:
    def __init__(
        self,
        algorithm: Algorithm,
        contestant: Contestant,
        bound: BoundTask,
        protocol: ComparisonProtocol,
        on_progress: Callable[[int], None],
    ) -> None:
        self._algorithm = algorithm
        self._external = algorithm.kind == "external"
        self._contestant = contestant
        self._guarded = contestant.agent.guarded
        self._bound = bound
        self._protocol = protocol
        self._on_progress = on_progress
        self._next_progress = 0.0
        self._evaluations: list[EvaluationRow] = []
        self._log = Log(bound.task.counters)
        self._watchdog = Watchdog(
            bound,
            SLOW_STEP_SECONDS,
            lambda: self._log.env_steps + 1,
            lambda line: warnings.warn(visible(line), Notice, stacklevel=2),
        )
        self._arena = Arena(bound.task, contestant.agent, protocol.evaluation_seed)

    def run(self) -> Measured:
        try:
            with self._watchdog:
                self._train()
        finally:
            self._arena.close()
        log = self._log
        seconds = {"training": log.seconds, "evaluation": log.pauses}
        characteristics = dict(self._contestant.characteristics)
        made_with = {**versions(), "python": platform.python_version()}
        return Measured(log, self._evaluations, characteristics, seconds, made_with, self._lead())

    def _lead(self) -> dict[str, Any] | None:
        if self._algorithm.kind != "guided":
            return None
        strategy = self._contestant.agent.strategy
        evidence = strategy.evidence
        return {"rho": strategy.rho, "evidence": None if evidence is None else evidence.as_dict()}

    def _train(self) -> None:
        budget = self._protocol.env_steps
        with contextlib.suppress(_Spent):
            self._contestant.train(budget, self._after_step)
        if self._external:
            if self._log.env_steps < budget:
                raise RunError(
                    f"`{self._algorithm.name}` made {self._log.env_steps} env steps of {budget} "
                    "and ended"
                )
            self._evaluate(last=True)

    def _after_step(self, step: StepRecord) -> None:
        log, protocol = self._log, self._protocol
        if log.env_steps >= protocol.env_steps:
            raise _Spent
        log.step(step)
        now = time.monotonic()
        if now >= self._next_progress:
            self._next_progress = now + 0.3
            self._on_progress(log.env_steps)
        if not protocol.due(log.env_steps):
            return
        last = log.env_steps >= protocol.env_steps
        if last and self._external:  # it still learns from the last steps, and then ends
            return
        self._evaluate(last=last)
        if last:
            raise _Spent

    def _evaluate(self, *, last: bool) -> None:
        episodes = self._protocol.final_episodes
        with self._log.paused():
            if self._algorithm.kind == "planner":
                if last:
                    self._play("planner", self._plan, episodes)
            elif last:
                self._play("learner", self._greedy_forecast, episodes)
                self._play("vetoed", self._contestant.vetoed, episodes)
            else:
                self._play("learner", self._greedy, self._protocol.evaluation_episodes)

    def _play(self, policy: str, decide: Decide, episodes: int) -> None:
        self._evaluations += self._arena.play(
            decide, episodes, policy=policy, env_steps=self._log.env_steps, trained_in=self._bound
        )

    # Policies ----------------------------------------------------------------------------------

    def _greedy(self, state: Vector, x: Vector) -> Decision:
        """Decide by the learner, without a forecast, which would take most of the time."""
        return without_forecast(self._contestant.greedy(state, x), self._bound.actions.size)

    def _greedy_forecast(self, state: Vector, x: Vector) -> Decision:
        """Decide by the learner, with a forecast."""
        action = self._contestant.greedy(state, x)
        return self._guarded.execute(state, Proposal(action, False, None))

    def _plan(self, state: Vector, x: Vector) -> Decision:
        return self._guarded.plan(state)


def without_forecast(action: int, size: int) -> Decision:
    """Return the decision for a choice of the learner without a forecast."""
    forecast = ActionForecast(
        choice=-1,
        ground=np.full(size, -1),
        value=np.full(size, -np.inf),
        path_risk=np.zeros(size),
        safe_steps=np.full(size, SAFE),
        reward=np.zeros(size),
        flags=np.zeros(size, dtype=np.int64),
        depth=0,
        bound=Bound.NODES,
        indifferent=False,
    )
    return Decision(
        action=action,
        executed_by=Actor.LEARNER,
        reason=Reason.ACCEPTED,
        proposed=action,
        proposed_by=Actor.LEARNER,
        rho=1.0,
        predicted_reward=np.nan,
        unsafe=False,
        risk=np.nan,
        proposal_unsafe=False,
        indifferent=False,
        admissible=np.ones(size, dtype=np.bool_),
        forecast=forecast,
    )
