"""Swing-up, hill and landing: their domain files say what is wanted, and nothing of motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from serp.tasks.registry import find_task
from serp.tasks.task import BoundTask

Step = tuple[NDArray[np.float64], int, NDArray[np.float64], bool, dict[str, bool]]
TASKS = ("swing-up", "hill", "landing")
each = pytest.mark.parametrize("name", TASKS)


def bound(name: str) -> BoundTask:
    return find_task(name).bind()


def at_random(task: BoundTask, steps: int, seed: int) -> list[Step]:
    """Steps of random actions, each held for up to six: state, action, next state, end."""
    rng = np.random.default_rng(seed)
    raw, _ = task.reset(seed=seed)
    found: list[Step] = []
    action, left = 0, 0
    for _ in range(steps):
        if not left:
            action, left = int(rng.integers(task.actions.size)), int(rng.integers(1, 7))
        left -= 1
        state = task.ground(raw)
        raw, _, terminated, truncated, info = task.step(action)
        found.append((state, action, task.ground(raw), terminated, info))
        if terminated or truncated:
            raw, _ = task.reset()
            left = 0
    return found


def ground_action(task: BoundTask, action: int) -> int:
    return task.model.action_index(task.actions.name(action))


@each
def test_the_file_says_what_is_wanted_and_nothing_of_what_happens(name: str) -> None:
    """Rewards are at most 0, so that nobody waits before the goal."""
    ends, rewards = 0, set()
    with bound(name) as task:
        steps = at_random(task, 3_000, 2)
        for state, action, after, terminated, info in steps:
            judged = task.model.judge(state, ground_action(task, action), after)
            assert judged.terminal == terminated
            assert judged.unsafe == (info.get("crashed", False) or info.get("lost", False))
            ends += terminated
            rewards.add(judged.reward)
        assert not task.model.ground.processes
        states = np.array([state for state, *_ in steps[:200]])
        for action in range(len(task.model.actions)):
            outcome = task.model.step(states, action)
            np.testing.assert_array_equal(outcome.state, states)
            assert outcome.applicable.all()
    assert (ends > 0) == (name != "swing-up")
    assert max(rewards) <= 0.0 and len(rewards) > 100
