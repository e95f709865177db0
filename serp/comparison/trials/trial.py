"""One trial: train one algorithm with one seed on one domain file, and measure it."""

from __future__ import annotations

import contextlib
import platform
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from serp._util.terminal import visible
from serp._util.threads import one_thread
from serp.comparison.algorithms import Algorithm
from serp.comparison.plan import ComparisonProtocol
from serp.comparison.trial_records import EvaluationRow
from serp.comparison.trials.arena import Arena
from serp.comparison.trials.contestant import Contestant, make_contestant
from serp.comparison.trials.log import Log
from serp.control.decision import Actor, Decision, Reason
from serp.control.step_record import StepRecord
from serp.errors import Notice, RunError
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.planning.action_map import ActionForecast
from serp.planning.forecast import SAFE
from serp.planning.limits import Bound
from serp.runs.config import versions
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.tasks.task import Task
from serp.tasks.watchdog import Watchdog
from serp.training.rollout import Decide


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
            contestant.agent.settings.training.slow_step_seconds,
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
