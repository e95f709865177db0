"""Every shipped task fits together, with the observations that really come."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from serp.tasks.registry import load_task, task_entries
from serp.tasks.task import BoundTask

STEPS = 300


@pytest.fixture(params=sorted(task_entries()))
def task(request: pytest.FixtureRequest) -> Iterator[BoundTask]:
    with load_task(request.param).bind() as bound:
        yield bound


def walk(task: BoundTask, seed: int) -> list[tuple[Any, ...]]:
    """Random steps: observation, ground action, environment's reward, whether it ended."""
    rng = np.random.default_rng(seed)
    raw, _ = task.reset(seed=seed)
    found: list[tuple[Any, ...]] = []
    for _ in range(STEPS):
        ground = int(rng.integers(len(task.model.actions)))
        after, reward, terminated, truncated, _ = task.step(task.actions.environment_action[ground])
        found.append((raw, ground, reward, terminated or truncated))
        raw = task.reset()[0] if terminated or truncated else after
    return found


def test_resets_and_steps_reproduce(task: BoundTask) -> None:
    for first, second in zip(walk(task, 3), walk(task, 3), strict=True):
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:] == second[1:]


def test_every_observation_is_a_state_and_every_transition_is_judged(task: BoundTask) -> None:
    """A state has the value of every fluent, and truth values are 0 or 1."""
    truths = [not fluent.numeric for fluent in task.model.fluents]
    steps = walk(task, 4)
    varied = np.array([task.ground(raw) for raw, *_ in steps])
    assert np.isfinite(varied).all()
    assert np.isin(varied[:, truths], (0.0, 1.0)).all()
    for (raw, ground, _, ended), (after, *_) in pairwise(steps):
        assert task.observation(raw).shape == (task.observation_size,)
        if not ended:
            task.model.judge(task.ground(raw), ground, task.ground(after))
