"""External algorithms for comparisons: DQN, PPO and MaskablePPO of stable-baselines3.

On cart-pole their settings are those that RL Baselines3 Zoo has tuned for CartPole-v1
(https://github.com/DLR-RM/rl-baselines3-zoo, commit eec15dc, `hyperparams/dqn.yml` and `ppo.yml`),
and those of DQN on the lunar lander are the zoo's, too. PPO's there update after 16,384 steps,
which is more than the default. On any other task they are the defaults of stable-baselines3, like
the zoo's `default` entry, but for those that assume a budget of a million env steps (`_DQN`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


class StableBaselines3:
    """A learner of stable-baselines3 on an environment.

    Stable-baselines3 draws from the global random generators of Python, NumPy and torch, which it
    seeds where the model is made. `learn` has to follow.

    Args:
        make: Makes the model.
        rollout: Env steps between two rounds of updates.

    Attributes:
        model: The model.
        first_update: Env steps until the first round of updates.
    """

    def __init__(self, make: Callable[[], BaseAlgorithm], rollout: Callable[[Any], int]) -> None:
        from stable_baselines3.common.logger import Logger

        self.model: Any = make()
        # The default logger makes a folder, even if it writes nothing.
        self._rollout = rollout(self.model)
        self.model.set_logger(Logger(None, []))
        rounds = getattr(self.model, "learning_starts", 0) // self._rollout + 1
        self.first_update = rounds * self._rollout

    def learn(self, env_steps: int) -> None:
        """Train for exactly this number of env steps.

        The schedules of exploration, learning rate and clipping span one call, so the whole budget
        must be given at once. Updates follow complete rollouts; an incomplete last rollout is not
        learned from.

        Args:
            env_steps: Number of env steps, at least 1.
        """
        model, end = self.model, self.model.num_timesteps + env_steps
        # If the last rollout is complete, its updates must not be skipped.
        stop = None if env_steps % self._rollout == 0 else lambda *_: model.num_timesteps < end
        with _one_thread():
            model.learn(env_steps, callback=stop, reset_num_timesteps=False)

    def act(self, inputs: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the greedy actions `[B]` for observations `[B, F]`: no exploration, no sampling.

        It may be called while `learn` runs, from within the environment.
        """
        actions, _ = self.model.predict(np.asarray(inputs, dtype=np.float32), deterministic=True)
        return np.asarray(actions, dtype=np.int64)


def dqn(env: gym.Env[Any, Any], task: str, seed: int) -> StableBaselines3:
    """stable-baselines3's DQN, with rl-zoo's settings where they exist.

    Args:
        env: Environment with flat observations and discrete actions; its reward is learned from.
        task: Name of the task.
        seed: Seed of everything random.
    """
    from stable_baselines3 import DQN

    settings = _TUNED_DQN.get(task, _DQN)
    return StableBaselines3(
        lambda: DQN("MlpPolicy", env, seed=seed, device="cpu", **settings),
        lambda model: model.train_freq.frequency,
    )


def ppo(env: gym.Env[Any, Any], task: str, seed: int) -> StableBaselines3:
    """stable-baselines3's PPO, with rl-zoo's settings where they exist.

    The zoo runs eight environments side by side on CartPole-v1, 32 steps each between updates. Here
    there is one, which makes the same 256 steps.

    Args:
        env: Environment with flat observations and discrete actions; its reward is learned from.
        task: Name of the task.
        seed: Seed of everything random.
    """
    from stable_baselines3 import PPO

    settings = _PPO_CARTPOLE if task == "cartpole" else {}
    return StableBaselines3(
        lambda: PPO("MlpPolicy", env, seed=seed, device="cpu", **settings),
        lambda model: model.n_steps,
    )


class MaskedPPO(StableBaselines3):
    """sb3-contrib's MaskablePPO, with the settings of `ppo`.

    Its masks are the actions that the domain file allows, in training and in evaluations: Huang and
    Ontañón 2022, "A closer look at invalid action masking in policy gradient algorithms", FLAIRS.

    Args:
        env: Environment with flat observations, discrete actions and `action_masks()`.
        task: Name of the task.
        seed: Seed of everything random.
    """

    masked = True

    def __init__(self, env: gym.Env[Any, Any], task: str, seed: int) -> None:
        from sb3_contrib import MaskablePPO

        settings = _PPO_CARTPOLE if task == "cartpole" else {}
        super().__init__(
            lambda: MaskablePPO("MlpPolicy", env, seed=seed, device="cpu", **settings),
            lambda model: model.n_steps,
        )

    def act(
        self, inputs: NDArray[np.float32], masks: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """Return the greedy actions `[B]` for observations `[B, F]` within masks `[B, E]`."""
        actions, _ = self.model.predict(inputs, deterministic=True, action_masks=masks)
        return np.asarray(actions, dtype=np.int64)


_TUNED_DQN: Final[Mapping[str, Mapping[str, Any]]] = {
    "cartpole": {
        "learning_rate": 2.3e-3,
        "batch_size": 64,
        "buffer_size": 100_000,
        "learning_starts": 1_000,
        "gamma": 0.99,
        "target_update_interval": 10,
        "train_freq": 256,
        "gradient_steps": 128,
        "exploration_fraction": 0.16,
        "exploration_final_eps": 0.04,
        "policy_kwargs": {"net_arch": [256, 256]},
    },
    "lunar-lander": {
        "learning_rate": 6.3e-4,
        "batch_size": 128,
        "buffer_size": 50_000,
        "learning_starts": 0,
        "gamma": 0.99,
        "target_update_interval": 250,
        "train_freq": 4,
        "gradient_steps": -1,
        "exploration_fraction": 0.12,
        "exploration_final_eps": 0.1,
        "policy_kwargs": {"net_arch": [256, 256]},
    },
}
_PPO_CARTPOLE: Final[Mapping[str, Any]] = {
    "n_steps": 8 * 32,
    "batch_size": 256,
    "gae_lambda": 0.8,
    "gamma": 0.98,
    "n_epochs": 20,
    "ent_coef": 0.0,
    # Linear schedules to 0 over the budget, `lin_` in the zoo.
    "learning_rate": lambda left: 0.001 * left,
    "clip_range": lambda left: 0.2 * left,
}
_DQN: Final[Mapping[str, Any]] = {
    # A million by default, which is more than any budget here and is allocated at once.
    "buffer_size": 50_000,
    # 10,000 by default: with budgets of some thousand steps it would never be copied. The zoo's
    # settings for Atari games have 1,000, too.
    "target_update_interval": 1_000,
}


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch compute on one thread, so that sums do not depend on the number of cores."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
