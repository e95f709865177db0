"""The learners of stable-baselines3, on a tiny environment."""

import importlib
import sys

import gymnasium as gym
import numpy as np
import pytest

import serp
from serp.errors import MissingExtra
from serp.runs.comparison.algorithms import find_algorithm, given
from serp.runs.comparison.trial import make_external
from serp.tasks.registry import find_task

pytest.importorskip("stable_baselines3")
pytest.importorskip("sb3_contrib")
from sb3_contrib import QRDQN, MaskablePPO
from stable_baselines3 import DQN
from stable_baselines3.common.env_checker import check_env

from serp_adapters import stable_baselines3
from serp_adapters.stable_baselines3 import ExecutedActionBuffer
from tests.serp.runs.runs import rows

MAKERS = {"dqn": stable_baselines3.dqn, "ppo": stable_baselines3.ppo}


@pytest.mark.parametrize("name", MAKERS)
def test_equal_seeds_give_equal_learners(name):
    inputs, acted = np.random.default_rng(0).standard_normal((99, 4)).astype(np.float32), []
    for seed in (3, 3, 4):
        learner = MAKERS[name](gym.make("CartPole-v1"), "cartpole", seed)
        learner.learn(600)
        acted.append(learner.act(inputs).tolist())
    assert acted[0] == acted[1] != acted[2]


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "serp_adapters.stable_baselines3")
    with pytest.raises(MissingExtra, match=r"`ppo`, `maskable-ppo`.*pip install 'serp\[sb3\]'"):
        importlib.import_module("serp_adapters.stable_baselines3")


def test_masks_are_what_the_file_allows():
    """In the taxi's town they are Gymnasium's own masks."""
    algorithm, random = find_algorithm("maskable-ppo"), np.random.default_rng(0)
    with find_task("taxi").bind() as bound:
        _, env, learner = make_external(algorithm, bound, algorithm.settings(bound.task, {}), 0)
        x, info = env.reset()
        for _ in range(150):
            masks = env.action_masks()
            assert (masks == info["action_mask"]).all()
            assert masks[learner.act(x[np.newaxis], masks[np.newaxis])].all()
            x, _, terminated, truncated, info = env.step(random.choice(np.flatnonzero(masks)))
            if terminated or truncated:
                x, info = env.reset()
        learner.learn(60)
    assert "domain file" in given("maskable-ppo") and "domain file" not in given("ppo")


# The file knows nothing of the slips at the cliff, so its lookahead fails.
pytestmark = pytest.mark.filterwarnings("ignore::serp.errors.Notice")

CHANGES = {
    "guide": {"strategy": "mixture"}, "arbiter": {"rho": 0.7}, "planner": {"name": "lookahead"},
    "learner": {"members": 1, "hidden": [8]},
}  # fmt: skip


def guarded(out=None):
    return serp.GuardedEnv("cliff", settings=CHANGES, seed=1, out=out)


def number_of(env, name):
    actions = env._task.actions
    return next(k for k in range(actions.size) if actions.name(k) == name)


@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning")
def test_it_is_an_environment_as_stable_baselines3_has_it():
    check_env(guarded())


@pytest.mark.parametrize("make", [DQN, QRDQN])
def test_off_policy_learners_remember_what_was_executed(make, tmp_path):
    env = guarded(tmp_path / "run")
    options = {"buffer_size": 500, "learning_starts": 30, "seed": 2, "device": "cpu"}
    buffer = {"replay_buffer_class": ExecutedActionBuffer}
    model = make("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, **options, **buffer)
    model.learn(150)
    env.close()
    decisions = rows(tmp_path / "run", "decisions")
    executed = [number_of(env, row["executed"]) for row in decisions]
    assert model.replay_buffer.actions[: len(decisions), 0, 0].tolist() == executed
    assert {row["executed_by"] for row in decisions} == {"planner", "learner"}
    assert any(row["vetoed"] == "1" for row in decisions)
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


def test_a_masked_learner_chooses_what_is_executed():
    """So its rollouts are on-policy, although the planner acts in between."""
    env = guarded()
    executed = []
    step = env.step

    def stepping(action):
        answer = step(action)
        executed.append(answer[-1]["executed_action"])
        return answer

    env.step = stepping
    model = MaskablePPO("MlpPolicy", env, n_steps=64, batch_size=32, device="cpu", seed=0)
    model.learn(64)
    buffer = model.rollout_buffer
    assert buffer.actions.reshape(-1).tolist() == executed
    masks = buffer.action_masks.reshape(64, -1)
    assert set(masks.sum(axis=1)) > {1.0}
    alone = masks.sum(axis=1) == 1.0
    # Where the planner acts, the masked policy has one action, whose gradient is 0.
    assert np.allclose(buffer.log_probs.reshape(-1)[alone], 0.0, atol=1e-6)
