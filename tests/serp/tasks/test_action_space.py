"""Every kind of discrete action space is one of actions counted from 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from serp.errors import TaskError
from tests.serp.sample_tasks import Corridor, corridor


class Valves(gym.ActionWrapper[Any, Any, Any]):
    """The corridor with the four actions as combinations of two numbers."""

    def __init__(self, space: spaces.Space[Any]) -> None:
        super().__init__(Corridor())
        self.action_space = space

    def action(self, action: Any) -> int:
        assert self.action_space.contains(action)
        first, second = np.ravel(action - getattr(self.action_space, "start", 0)).tolist()
        return int(2 * first + second)


SPACES = [
    spaces.MultiDiscrete([2, 2]),
    spaces.MultiDiscrete([[2], [2]], start=[[3], [-1]]),
    spaces.MultiBinary(2),
]


def walk(folder: Path, make_env: Any, **changes: Any) -> list[Any]:
    """Return what 60 steps in the corridor return."""
    seen = []
    with corridor(folder, make_env, **changes).bind() as bound:
        assert bound.actions.size == 4
        bound.reset(seed=1)
        for action in np.random.default_rng(0).integers(4, size=60).tolist():
            raw, *rest, _ = bound.step(action)
            seen.append((raw.tolist(), *rest))
            if rest[1] or rest[2]:
                bound.reset()
    return seen


@pytest.mark.parametrize("make", [lambda: Corridor(10), *(lambda s=s: Valves(s) for s in SPACES)])
def test_actions_are_counted_from_zero_in_every_space(tmp_path: Path, make: Any) -> None:
    assert walk(tmp_path, make) == walk(tmp_path, Corridor)


@pytest.mark.parametrize("space", SPACES)
def test_a_combination_is_named_by_its_tuple_or_number(tmp_path: Path, space: Any) -> None:
    named = {"left": (0, 1), "right": [1, 0], "wait": np.int64(3)}
    bound = corridor(tmp_path, lambda: Valves(space), actions=named).bind()
    assert bound.actions.environment_action == [1, 2, 3]
    for wrong in ((0, 2), (0,), (-1, 0), (0.5, 1), "01", None):
        with pytest.raises(TaskError, match=r"corridor.*actions: `left` is mapped to .*0 "):
            corridor(tmp_path, lambda: Valves(space), actions=named | {"left": wrong}).bind()
