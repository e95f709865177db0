"""Model variants: domain files beside a task's own, which know less of it or get it wrong.

That they are portable, and that nothing was forgotten in them, is tested with all shipped files.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from serp.model.transition_model import Judgement, Vector
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task, task_entries
from serp.tasks.task import BoundTask

FOLDER = Path(__file__).resolve().parents[2] / "domains"
VARIANTS = sorted(
    path.stem
    for path in FOLDER.glob("*.pddl")
    if path.stem not in task_entries() and not path.stem.endswith("-problem")
)


def bound(name: str) -> BoundTask:
    return find_task(str(FOLDER / f"{name}.pddl")).bind()


def transitions(task: BoundTask, steps: int) -> Iterator[tuple[Vector, int, Vector]]:
    """What happens when actions are drawn at random."""
    rng = np.random.default_rng(11)
    raw, _ = task.reset(seed=11)
    for _ in range(steps):
        state, action = task.ground(raw), int(rng.integers(task.actions.size))
        raw, _, terminated, truncated, _ = task.step(action)
        yield state, action, task.ground(raw)
        if terminated or truncated:
            raw, _ = task.reset()


@pytest.mark.parametrize("name", VARIANTS)
def test_it_differs_from_the_own_file_in_its_predictions_alone(name: str) -> None:
    """Who learns with a variant has the same words and rewards, and the same is unsafe."""
    with bound(name) as variant, bound(variant.name) as full:
        assert variant.domain.name == name and name.startswith(f"{variant.name}-")
        assert variant.model.fluents == full.model.fluents
        assert [a.name for a in variant.model.actions] == [a.name for a in full.model.actions]
        assert variant.actions.environment_action == full.actions.environment_action
        assert variant.rewarded_by == full.rewarded_by
        steps = list(transitions(full, 1_500))
        seen: list[Judgement] = []
        for state, action, after in steps:
            ground = full.model.action_index(full.actions.name(action))
            seen.append(full.model.judge(state, ground, after))
            assert variant.model.judge(state, ground, after) == seen[-1]
        assert {judged.unsafe for judged in seen} == {True, False}
        assert {judged.terminal for judged in seen} == {True, False}
        assert len({judged.reward for judged in seen}) > 2
        states = np.array([state for state, _, _ in steps[:300]])
        different = False
        for action in range(len(full.model.actions)):
            here, there = (m.step(states, action) for m in (variant.model, full.model))
            different |= not np.array_equal(here.state, there.state)
            different |= not np.array_equal(here.reward, there.reward)
        assert different


@pytest.mark.parametrize("name", [*VARIANTS, *task_entries()])
def test_serp_learns_with_every_shipped_file(name: str) -> None:
    with bound(name) as task:
        trainer = Trainer(task, resolve("default", task.task.settings), seed=1)
        assert trainer.run_episode().length >= 1
