"""Evaluating a policy: the trained mixture, the planner alone, or the learner alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from serp.agent import Agent
from serp.domain.codegen import UNSAFE
from serp.domain.model import Vector
from serp.domain.source import did_you_mean
from serp.errors import SettingsError
from serp.quantities import seed_of, whole
from serp.task import BoundTask

Policy = Literal["serp", "planner", "learner"]
_SEEDS = 2  # spawn key of the environment's seeds


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


def evaluate(
    agent: Agent, task: BoundTask, policy: Policy = "serp", *, episodes: int = 20, seed: int = 0
) -> EvaluationResult:
    """Run a policy without exploring or learning; no random state of the agent changes.

    Args:
        agent: The agent.
        task: The task, in an environment that nobody else uses.
        policy: Which policy.
        episodes: How many episodes, at least 1.
        seed: Seed of the environment; other than any that training uses.

    Raises:
        SettingsError: There is no such policy, no episode is asked for, or the seed is none.
        TaskError: The grounding failed.
        EnvironmentFailure: The environment raised or gave NaN.
    """
    policies = _policies(agent)
    if not isinstance(policy, str) or policy not in policies:
        raise SettingsError(f"there is no policy `{policy}`; {did_you_mean(str(policy), policies)}")
    count = whole(episodes, 1)
    if count is None:
        raise SettingsError(
            f"episodes must be a whole number, at least one for an evaluation, not {episodes!r}"
        )
    seed = seed_of(seed)
    act = policies[policy]
    returns: list[float] = []
    lengths: list[int] = []
    ended = unsafe = vetoes = 0
    for episode in range(count):
        sequence = np.random.SeedSequence(entropy=seed, spawn_key=(_SEEDS, episode))
        raw, _ = task.reset(seed=int(sequence.generate_state(1)[0]))
        total, length = 0.0, 0
        while True:
            state, x = agent.perceive(raw)
            action, was_unsafe, was_vetoed = act(state, x)
            unsafe += was_unsafe
            vetoes += was_vetoed
            raw, reward, terminated, truncated, _ = task.step(action)
            total += reward
            length += 1
            if terminated or truncated or length >= agent.settings.training.episode_steps:
                break
        ended += terminated
        returns.append(total)
        lengths.append(length)
    return EvaluationResult(policy, tuple(returns), tuple(lengths), ended, unsafe, vetoes)


def _policies(agent: Agent) -> dict[str, Callable[[Vector, Vector], tuple[int, bool, bool]]]:
    """Return for each policy the function (state, input) → action, unsafe, vetoed."""

    def serp(state: Vector, x: Vector) -> tuple[int, bool, bool]:
        decision = agent.decide_greedily(state, x)
        return decision.action, decision.unsafe, decision.vetoed

    def planner(state: Vector, x: Vector) -> tuple[int, bool, bool]:
        decision = agent.arbiter.plan(state)
        return decision.action, decision.unsafe, False

    def learner(state: Vector, x: Vector) -> tuple[int, bool, bool]:
        action = int(agent.learner.greedy(x))
        return action, bool(agent.arbiter.forecast(state).flags[action] & UNSAFE), False

    return {"serp": serp, "planner": planner, "learner": learner}
