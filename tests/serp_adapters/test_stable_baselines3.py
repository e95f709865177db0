"""The learners of stable-baselines3, on a tiny environment."""

import csv
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import serp
from serp.errors import MissingExtra

pytest.importorskip("stable_baselines3")
pytest.importorskip("sb3_contrib")
from sb3_contrib import QRDQN, MaskablePPO
from stable_baselines3 import DQN
from stable_baselines3.common.env_checker import check_env

from serp_adapters import stable_baselines3
from serp_adapters.stable_baselines3 import ExecutedActionBuffer, StableBaselines3

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


# The file knows nothing of the slips at the cliff, so its lookahead fails.
pytestmark = pytest.mark.filterwarnings("ignore::serp.errors.Notice")

CHANGES: dict[str, Any] = {
    "guide": {"strategy": "mixture"}, "arbiter": {"rho": 0.7}, "planner": {"name": "lookahead"},
    "learner": {"members": 1, "hidden": [8]},
}  # fmt: skip


def guarded(out: Path | None = None) -> serp.GuardedEnv:
    return serp.GuardedEnv("cliff", settings=CHANGES, seed=1, out=out)


def number_of(env: serp.GuardedEnv, name: str) -> int:
    actions = env._task.actions
    return next(k for k in range(actions.size) if actions.name(k) == name)


@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning")
def test_it_is_an_environment_as_stable_baselines3_has_it() -> None:
    check_env(guarded())


@pytest.mark.parametrize("make", [DQN, QRDQN])
def test_off_policy_learners_remember_what_was_executed(make: Any, tmp_path: Path) -> None:
    env = guarded(tmp_path / "run")
    options = {"buffer_size": 500, "learning_starts": 30, "seed": 2, "device": "cpu"}
    buffer = {"replay_buffer_class": ExecutedActionBuffer}
    model = make("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, **options, **buffer)
    model.learn(150)
    env.close()
    with open(tmp_path / "run" / "decisions.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    executed = [number_of(env, row["executed"]) for row in rows]
    assert model.replay_buffer.actions[: len(rows), 0, 0].tolist() == executed
    assert {row["executed_by"] for row in rows} == {"planner", "learner"}
    assert any(row["vetoed"] == "1" for row in rows)
    # What the library saves and loads is all that it has of its own.
    model.save(tmp_path / "model")
    model.save_replay_buffer(tmp_path / "buffer")
    again = make.load(tmp_path / "model", env=guarded(), device="cpu")
    again.load_replay_buffer(tmp_path / "buffer")
    assert type(again.replay_buffer) is ExecutedActionBuffer
    x = np.stack([model.replay_buffer.observations[k, 0] for k in range(50)])
    assert (
        again.predict(x, deterministic=True)[0] == model.predict(x, deterministic=True)[0]
    ).all()
    again.learn(20, reset_num_timesteps=False)


def test_a_masked_learner_chooses_what_is_executed() -> None:
    """So its rollouts are on-policy, although the planner acts in between."""
    env = guarded()
    executed = []
    step = env.step

    def stepping(action: Any) -> Any:
        answer = step(action)
        executed.append(answer[-1]["executed_action"])
        return answer

    env.step = stepping  # type: ignore[method-assign]
    model = MaskablePPO("MlpPolicy", env, n_steps=64, batch_size=32, device="cpu", seed=0)
    model.learn(64)
    buffer = model.rollout_buffer
    assert buffer.actions.reshape(-1).tolist() == executed
    masks = buffer.action_masks.reshape(64, -1)
    assert set(masks.sum(axis=1)) > {1.0}
    alone = masks.sum(axis=1) == 1.0
    # Where the planner acts, the masked policy has one action, whose gradient is 0.
    assert np.allclose(buffer.log_probs.reshape(-1)[alone], 0.0, atol=1e-6)
