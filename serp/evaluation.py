"""Evaluating a policy: the trained mixture, the planner alone, or the learner alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from serp.agent import Agent
from serp.arbiter import Decision
from serp.domain.model import Vector
from serp.domain.source import did_you_mean
from serp.errors import SettingsError
from serp.quantities import seed_of, whole
from serp.tally import Tally
from serp.task import BoundTask

Policy = Literal["serp", "planner", "learner"]
_SEEDS = 2  # spawn key of the environment's seeds
_Policy = Callable[[Vector, Vector], Decision]  # (state, input of the learner) → decision


@dataclass(frozen=True)
class EvaluationResult:
    """Returns of a policy over some episodes.

    Attributes:
        policy: `serp`: the learner's greedy choice within the vetoes. `planner`: the planner
            alone. `learner`: the learner's greedy choice alone, no veto.
        returns: The environment's return of each episode.
        lengths: Steps of each episode.
        terminated: Episodes that the environment ended (others met a limit).
        unsafe_executed: Executed actions that the model predicts unsafe.
        vetoes: Proposals refused.
    """

    policy: str
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    terminated: int
    unsafe_executed: int
    vetoes: int

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values: the fields, and mean, standard deviation, median and extremes."""
        returns = np.array(self.returns)
        return {
            **{k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()},
            "episodes": len(self.returns),
            "mean": float(returns.mean()),
            "std": float(returns.std(ddof=1)) if len(returns) > 1 else 0.0,
            "median": float(np.median(returns)),
            "min": float(returns.min()),
            "max": float(returns.max()),
        }


class Step(NamedTuple):
    """One step of a policy.

    Attributes:
        number: Which step of the episode, from 1.
        observation: What the environment showed, as it gave it.
        state: The state `[F]` that this was grounded to, and decided on.
        decision: What was done, who did it and why.
        reward: The environment's reward.
        terminated: Whether the environment ended the episode here.
        truncated: Whether the environment cut it off here.
        last: Whether it is over, by one of these or by the limit `training.episode_steps`.
        info: What the environment says besides.
    """

    number: int
    observation: Any
    state: Vector
    decision: Decision
    reward: float
    terminated: bool
    truncated: bool
    last: bool
    info: dict[str, Any]


class Episode(NamedTuple):
    """An episode that stands at its beginning, right after the reset.

    Attributes:
        number: Which episode, from 1.
        info: What the environment said at the reset.
        steps: Its steps, each carried out when it is asked for.
    """

    number: int
    info: dict[str, Any]
    steps: Iterator[Step]


def play(
    agent: Agent, task: BoundTask, policy: Policy = "serp", *, episodes: int = 20, seed: int = 0
) -> Iterator[Episode]:
    """Run a policy without exploring or learning; no random state of the agent changes.

    The next episode begins when it is asked for, whether or not the one before was finished.

    Args:
        agent: The agent.
        task: The task, in an environment that nobody else uses.
        policy: Which policy; see `EvaluationResult`.
        episodes: How many episodes, at least 1.
        seed: Seed of the environment; other than any that training uses.

    Raises:
        SettingsError: There is no such policy, no episode is asked for, or the seed is none.
        TaskError: The grounding failed (while steps are asked for).
        EnvironmentFailure: The environment raised or gave NaN (likewise).
    """
    policies = _policies(agent)
    if not isinstance(policy, str) or policy not in policies:
        raise SettingsError(f"there is no policy `{policy}`; {did_you_mean(str(policy), policies)}")
    count = whole(episodes, 1)
    if count is None:
        raise SettingsError(
            f"episodes must be a whole number, at least one for an evaluation, not {episodes!r}"
        )
    return _play(agent, task, policies[policy], count, seed_of(seed))


def _play(
    agent: Agent, task: BoundTask, decide: _Policy, episodes: int, seed: int
) -> Iterator[Episode]:
    for episode in range(episodes):
        raw, info = task.reset(seed=episode_seed(seed, episode))
        yield Episode(episode + 1, info, _steps(agent, task, decide, raw))


def episode_seed(seed: int, episode: int) -> int:
    """Return the environment's seed for an episode, from 0, of an evaluation."""
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(_SEEDS, episode))
    return int(sequence.generate_state(1)[0])


def _steps(agent: Agent, task: BoundTask, decide: _Policy, raw: Any) -> Iterator[Step]:
    number, last = 0, False
    while not last:
        seen, number = raw, number + 1
        state, x = agent.perceive(seen)
        decision = decide(state, x)
        raw, reward, terminated, truncated, info = task.step(decision.action)
        limit = number >= agent.settings.training.episode_steps
        last = terminated or truncated or limit
        yield Step(number, seen, state, decision, reward, terminated, truncated, last, info)


def evaluate(
    agent: Agent, task: BoundTask, policy: Policy = "serp", *, episodes: int = 20, seed: int = 0
) -> EvaluationResult:
    """Measure a policy; see `play`, which takes the same arguments and raises the same errors."""
    returns: list[float] = []
    lengths: list[int] = []
    ended = 0
    tally = Tally()
    for episode in play(agent, task, policy, episodes=episodes, seed=seed):
        total, length = 0.0, 0
        for step in episode.steps:
            total += step.reward
            length = step.number
            tally.count(step.decision)
            ended += step.terminated
        returns.append(total)
        lengths.append(length)
    return EvaluationResult(
        policy, tuple(returns), tuple(lengths), ended, tally.unsafe_executed, tally.vetoes
    )


def _policies(agent: Agent) -> dict[str, _Policy]:
    return {
        "serp": agent.decide_greedily,
        "planner": lambda state, x: agent.arbiter.plan(state),
        "learner": agent.decide_alone,
    }
