"""Evaluating beside a training is what evaluating a run is."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from gymnasium.wrappers import NormalizeObservation, TimeLimit

from serp.runs.comparison.trial import Arena
from serp.runs.evaluation import evaluate
from serp.runs.rollout import Decide
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.task import BoundTask, Task
from tests.serp.runs.comparison.contest import Walk, walk

SEED = 11


def trained(task: Task, episodes: int = 4, **changes: Any) -> tuple[Trainer, BoundTask]:
    bound = task.bind()
    trainer = Trainer(bound, resolve("default", task.settings, changes), 2)
    for _ in range(episodes):
        trainer.run_episode()
    return trainer, bound


def acting(trainer: Trainer) -> dict[str, Decide]:
    """Policies as a trial plays them."""
    agent = trainer.agent
    return {
        "learner": agent.decide_as_baseline,
        "serp": agent.decide_greedily,
        "planner": lambda state, x: agent.arbiter.plan(state),
    }


def play(task: Task, trainer: Trainer, bound: BoundTask, policy: str, n: int) -> Any:
    with contextlib.closing(Arena(task, trainer.agent, SEED)) as arena:
        return arena.play(acting(trainer)[policy], n, policy=policy, env_steps=7, trained_in=bound)


@pytest.mark.parametrize("policy", ["learner", "serp", "planner"])
def test_it_is_the_evaluation_of_a_run(tmp_path: Path, policy: Any) -> None:
    task, episodes = walk(tmp_path), 20
    trainer, bound = trained(task)
    before = str(trainer.agent.state_dict()[1])
    rows = play(task, trainer, bound, policy, episodes)
    assert str(trainer.agent.state_dict()[1]) == before  # nothing was drawn
    assert all((row.outcome != "") == row.terminated for row in rows)
    with task.bind() as own:
        expected = evaluate(trainer.agent, own, policy, episodes=episodes, seed=SEED)
    assert tuple(row.return_ for row in rows) == expected.returns
    assert tuple(row.length for row in rows) == expected.lengths
    assert sum(row.terminated for row in rows) == expected.terminated
    assert sum(row.unsafe for row in rows) == expected.unsafe_executed
    assert sum(row.unsafe_observed or 0 for row in rows) == expected.unsafe_observed
    assert [row.episode for row in rows] == list(range(1, episodes + 1))
    assert {(row.policy, row.env_steps) for row in rows} == {(policy, 7)}


def test_what_the_learner_learned_to_see_is_what_it_sees(tmp_path: Path) -> None:
    """Running statistics are those of training, and of no evaluation."""
    counts: list[float] = []

    class Seen(NormalizeObservation):
        def reset(self, **options: Any) -> Any:
            counts.append(self.obs_rms.count)
            return super().reset(**options)

    task = walk(
        tmp_path,
        lambda: Seen(TimeLimit(Walk(), 9)),
        ground=lambda seen: {"x": round(float(seen[0]), 1)},
    )
    trainer, bound = trained(task)
    trained_on = bound.env.get_wrapper_attr("obs_rms").count
    arena = Arena(task, trainer.agent, SEED)
    act = acting(trainer)["learner"]
    for _ in range(2):
        counts.clear()
        arena.play(act, 4, policy="learner", env_steps=0, trained_in=bound)
        assert counts == [trained_on] * 4
    arena.close()
    assert bound.env.get_wrapper_attr("obs_rms").count == trained_on
