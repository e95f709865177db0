"""The learners of stable-baselines3, on a tiny environment."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from serp.errors import MissingExtra

pytest.importorskip("stable_baselines3")


from serp_adapters import stable_baselines3
from serp_adapters.stable_baselines3 import StableBaselines3

Make = Callable[[gym.Env[Any, Any], str, int], StableBaselines3]
MAKERS: dict[str, Make] = {"dqn": stable_baselines3.dqn, "ppo": stable_baselines3.ppo}
CASES = [(name, task) for name in MAKERS for task in ("cartpole", "other")]


class Sign(gym.Env[Any, Any]):
    """One of two actions is rewarded, depending on the sign of a number; 8 steps an episode."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = spaces.Discrete(2)

    def __init__(self) -> None:
        self.steps = 0
        self.actions: list[int] = []
        self.during: Callable[[], None] = lambda: None

    def _seen(self) -> Any:
        self._x = float(self.np_random.uniform(-1.0, 1.0))
        return np.array([self._x, 1.0], dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._left = 8
        return self._seen(), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        self.actions.append(int(action))
        self.during()
        reward = float(action == (self._x > 0.0))
        self._left -= 1
        return self._seen(), reward, False, self._left == 0, {}


INPUTS = np.stack([np.linspace(-1.0, 1.0, 41), np.ones(41)], axis=1).astype(np.float32)


@pytest.mark.parametrize(("name", "task"), CASES)
def test_it_makes_exactly_so_many_steps(name: str, task: str) -> None:
    for budget in (3, 256, 300):
        env = Sign()
        MAKERS[name](env, task, 0).learn(budget)
        assert env.steps == budget


@pytest.mark.parametrize(("name", "task"), CASES)
def test_equal_seeds_give_equal_learners(name: str, task: str) -> None:
    played = []
    for seed in (3, 3, 4):
        env = Sign()
        learner = MAKERS[name](env, task, seed)
        learner.learn(600)
        played.append((env.actions, learner.act(INPUTS).tolist()))
    assert played[0] == played[1]
    assert played[0][0] != played[2][0]


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "serp_adapters.stable_baselines3")
    with pytest.raises(MissingExtra, match=r"`sb3-dqn`, `ppo`.*pip install 'serp\[sb3\]'"):
        importlib.import_module("serp_adapters.stable_baselines3")
