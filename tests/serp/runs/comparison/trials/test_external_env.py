"""The environment of an external algorithm: the same as our own learner has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from serp.agent.agent import Agent
from serp.agent.step_record import StepRecord
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.trial import ExternalEnv, make_contestant
from serp.settings import Settings, resolve
from serp.tasks.task import Task
from tests.serp.runs.comparison.contest import Walk, walk
from tests.serp.sample_tasks import Corridor

SEED = 5


def settings_of(task: Task, **changes: Any) -> Settings:
    return resolve("default", task.settings, changes)


class Noting(Walk):
    """Notes the seeds of its episodes."""

    seeds: list[int | None]

    def reset(self, *, seed: int | None = None, **options: Any) -> Any:
        self.seeds.append(seed)
        return super().reset(seed=seed, **options)


@pytest.mark.parametrize("reward", ["domain", "environment"])
def test_an_external_one_meets_what_our_learner_meets(tmp_path: Path, reward: Any) -> None:
    """With the actions that our learner took: the same seeds, observations, rewards and ends."""
    ours: list[int | None] = []
    task = walk(tmp_path, type("Ours", (Noting,), {"seeds": ours}), reward=reward)
    bound = task.bind()
    changes = {"training": {"episode_steps": 9}}
    algorithm = find_algorithm("dqn")
    settings = algorithm.settings(task, changes)
    trainer = make_contestant(algorithm, bound, settings, SEED)
    met: list[tuple[Any, ...]] = []
    learner = trainer.agent.learner
    remember = learner.remember

    def noting(x: Any, action: int, earned: float, following: Any, *rest: Any) -> None:
        met.append((x, action, earned, following, *rest[:2]))
        remember(x, action, earned, following, *rest)

    learner.remember = noting  # type: ignore[assignment, method-assign]
    made: list[StepRecord] = []
    trainer.train(150, made.append)

    theirs: list[int | None] = []
    task = walk(tmp_path, type("Theirs", (Noting,), {"seeds": theirs}), reward=reward)
    bound = task.bind()
    seen: list[StepRecord] = []
    env = ExternalEnv(bound, Agent(bound, settings, SEED), SEED, seen.append)
    x, _ = env.reset(seed=123)  # a seed of its own would not be the same protocol
    for before, action, earned, following, terminated, truncated in met:
        assert (x == before.astype(np.float32)).all()
        assert env.observation_space.contains(x)
        x, *outcome, _ = env.step(np.int64(action))
        assert outcome == [earned, terminated, truncated]
        assert (x == following.astype(np.float32)).all()
        if terminated or truncated:
            x, _ = env.reset()
    assert theirs[: len(ours)] == ours
    for one, other in zip(made, seen, strict=True):
        assert other.decision.action == one.decision.action
        assert other.decision.unsafe == one.decision.unsafe
        assert not other.decision.vetoed
        for name in ("reward", "env_reward", "terminated", "truncated"):
            assert getattr(other, name) == getattr(one, name)
    assert any(t.truncated for t in seen)
    assert any(t.decision.unsafe for t in seen)


def drawn_by(agent: Agent) -> str:
    """All random state of an agent; the planner, which draws nothing, remembers what it found."""
    return str({name: of for name, of in agent.state_dict()[1].items() if name != "planner"})


def test_it_is_an_environment_as_gymnasium_has_it(tmp_path: Path) -> None:
    task = walk(
        tmp_path, lambda: Corridor(start=3)
    )  # its first action is 3, an external one's is 0
    bound = task.bind()
    agent = Agent(bound, settings_of(task), 0)
    drawn = drawn_by(agent)
    env = ExternalEnv(bound, agent, 0)
    assert env.action_space.n == 4  # type: ignore[attr-defined]
    assert env.observation_space.shape == (3,)
    assert env.observation_space.dtype == np.float32
    with pytest.raises(gym.error.ResetNeeded):
        env.step(0)
    for _ in range(3):
        env.reset()
        over = False
        while not over:
            _, _, terminated, truncated, _ = env.step(1)
            over = terminated or truncated
        with pytest.raises(gym.error.ResetNeeded):
            env.step(1)
    assert drawn_by(agent) == drawn
