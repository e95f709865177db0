"""Evaluation of the policies of a trained agent; see `serp.runs.Policy`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, get_args

import numpy as np

from serp._util.did_you_mean import did_you_mean
from serp._util.numbers import seed_of, whole
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.agent.step_record import EpisodeTotals, StepRecord, sight_of
from serp.errors import SettingsError
from serp.model.transition_model import Vector
from serp.runs import Policy as Policy
from serp.runs.recording import Recorder
from serp.runs.rollout import Rollout, evaluation_seed
from serp.runs.summary import WINDOW
from serp.tasks.environment import BoundTask
from serp.tasks.task import Judge

Decide = Callable[[Vector, Vector], Decision]
"""(state, input of the learner) → decision."""
EPISODES: Final = 100
"""Default number of episodes."""


@dataclass(frozen=True)
class EvaluationResult:
    """Returns of a policy over some episodes.

    Attributes:
        meaning: A description of the policy under the agent's strategy.
        returns, lengths: The environment's return and the steps of each episode.
        terminated: Number of episodes that the environment ended; the others reached a limit.
        unsafe_executed: Number of executed actions that the domain file flags unsafe.
        avoidable_unsafe: Number of those that were executed while another one was not flagged.
        unsafe_observed: Number of steps that came out unsafe, foreseen or not.
        vetoes: Number of proposals refused.
        sight: How far the planner saw, see `serp.agent.step_record.sight_of`.
    """

    policy: str
    meaning: str
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    terminated: int
    unsafe_executed: int
    avoidable_unsafe: int
    unsafe_observed: int
    vetoes: int
    sight: Mapping[str, float | None]

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    @property
    def interval(self) -> tuple[float, float] | None:
        """Ends of the 95 % confidence interval of the mean (Student's t); None for one episode."""
        count = len(self.returns)
        if count < 2:
            return None
        from scipy.stats import t  # takes half a second to import

        error = float(np.std(self.returns, ddof=1)) / math.sqrt(count)
        reach = float(t.ppf((1.0 + 0.95) / 2.0, count - 1)) * error
        return self.mean - reach, self.mean + reach

    @property
    def warning(self) -> str | None:
        """A warning of too few episodes; None if there are enough."""
        if (count := len(self.returns)) >= WINDOW:
            return None
        rough = f"There are few episodes ({count}), so mean and interval are rough."
        return f"{rough} Use at least {WINDOW}."

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values: the fields, and statistics of the returns."""
        returns = np.array(self.returns)
        return {
            **{k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()},
            "episodes": len(self.returns),
            "mean": float(returns.mean()),
            "confidence_interval": None if self.interval is None else list(self.interval),
            "warning": self.warning,
            "std": float(returns.std(ddof=1)) if len(returns) > 1 else 0.0,
            "median": float(np.median(returns)),
            "min": float(returns.min()),
            "max": float(returns.max()),
        }


def play(
    agent: Agent,
    task: BoundTask,
    policy: Policy = "serp",
    *,
    episodes: int = EPISODES,
    seed: int = 0,
    recorder: Recorder | None = None,
) -> Generator[Iterator[StepRecord]]:
    """Run a policy without exploring or learning; no random state of the agent changes.

    Each episode is yielded right after its reset, as an iterator that executes its steps.

    The environment of the task is not used otherwise. Steps are recorded, if there is a recorder,
    before they are yielded. Advancing the iterator begins the next episode, even if the previous
    one is not finished. Equal seeds give other episodes than in training.

    Raises:
        SettingsError: There is no such policy, or `episodes` or `seed` is out of range.
        TaskError: The grounding failed (in a step).
        EnvironmentFailure: The environment raised or gave NaN (in a step).
    """
    count, seed = whole(episodes, 1), seed_of(seed)
    check_policy(policy)
    if count is None:
        raise SettingsError(
            f"episodes must be a whole number, at least one for an evaluation, not {episodes!r}"
        )
    judge, decide = Judge(task), _decisions(agent, policy)

    def steps_of(rollout: Rollout, number: int) -> Iterator[StepRecord]:
        while not rollout.over:
            step = rollout.step(decide(rollout.state, rollout.x))
            if recorder is not None:
                recorder.append(number, step)
            yield step

    with agent.undisturbed():
        for episode in range(count):
            rollout = Rollout(task, agent, judge, evaluation_seed(seed, episode))
            yield steps_of(rollout, episode + 1)


def check_policy(policy: str) -> None:
    """Check that there is a policy of that name."""
    policies = get_args(Policy)
    if policy not in policies:
        raise SettingsError(f"there is no policy `{policy}`; {did_you_mean(str(policy), policies)}")


def outcome_of(info: Mapping[str, Any]) -> str:
    """Return the outcome of an episode that the environment's info names; empty if none."""
    outcome = info.get("outcome")
    return outcome if isinstance(outcome, str) else ""


def evaluate(
    agent: Agent,
    task: BoundTask,
    policy: Policy = "serp",
    *,
    episodes: int = EPISODES,
    seed: int = 0,
    on_episode: Callable[[], None] = lambda: None,
    recorder: Recorder | None = None,
) -> EvaluationResult:
    """Evaluate a policy; arguments and errors are those of `play`.

    `on_episode` is called at the end of each episode.
    """
    totals: list[EpisodeTotals] = []
    for steps in play(agent, task, policy, episodes=episodes, seed=seed, recorder=recorder):
        for step in steps:
            last = step
        totals.append(last.episode)
        on_episode()
    counts: Counter[str] = Counter()
    for total in totals:
        counts.update(total.decisions.numbers())
    return EvaluationResult(
        policy=policy,
        meaning=meaning_of(agent, policy),
        returns=tuple(total.return_ for total in totals),
        lengths=tuple(total.length for total in totals),
        terminated=sum(total.terminated for total in totals),
        unsafe_executed=counts["unsafe_executed"],
        avoidable_unsafe=sum(total.avoidable_unsafe for total in totals),
        unsafe_observed=sum(total.unsafe_observed for total in totals),
        vetoes=counts["vetoes"],
        sight=sight_of(counts, sum(total.length for total in totals)),
    )


def meaning_of(agent: Agent, policy: Policy) -> str:
    """Return a description of a policy of an agent."""
    vetoes = "with vetoes (the planner's choice replaces a vetoed one)"
    return {
        "serp": f"{agent.strategy.choice}, {vetoes}",
        "planner": "the planner alone",
        "learner": "the learner's choice, without vetoes",
    }[policy]


def _decisions(agent: Agent, policy: Policy) -> Decide:
    if policy == "serp":
        return agent.decide_greedily
    if policy == "learner":
        return lambda state, x: agent.arbiter.execute(state, agent.learner.propose_greedily(x))
    return lambda state, x: agent.arbiter.plan(state)
