"""How fast trainings are.

    python -m tests.benchmarks.bench_training [--steps 3000] [--rounds 3] [--only sb3,envs]

`sb3`: env steps per second of processor time on cart-pole, beside the DQN of stable-baselines3 with
the same network, batch and updates, and with its defaults.
`envs`: soccer, env steps per second of wall time with 1 and 4 environments.
What is compared takes turns; medians of the rounds. One thread, as torch has it here.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np

import serp
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import load_task

SAME: dict[str, Any] = {
    "hidden": (64, 64), "members": 1, "layer_norm": False, "batch_size": 64,
    "updates_per_step": 1.0, "learning_starts": 200,
}  # fmt: skip
SAME_SB3: dict[str, Any] = {
    "policy_kwargs": {"net_arch": [64, 64]}, "batch_size": 64, "train_freq": 1,
    "gradient_steps": 1, "learning_starts": 200,
}  # fmt: skip


def trained(task: serp.Task, steps: int, changes: Any = None, seed: int = 0) -> tuple[float, ...]:
    """Train; return env steps, seconds of processor time and of wall time."""
    with task.bind() as bound:
        settings = resolve("default", bound.task.settings, changes)
        with Trainer(bound, settings, seed) as trainer:
            wall, start = time.perf_counter(), time.process_time()
            while trainer.env_steps < steps:
                for _ in trainer.run():
                    pass
            return trainer.env_steps, time.process_time() - start, time.perf_counter() - wall


def sb3(steps: int, seed: int, given: Mapping[str, Any]) -> float:
    """Train the DQN of stable-baselines3; return env steps per second of processor time."""
    from stable_baselines3 import DQN

    env = gym.make("serp_envs:serp/CartPole-v0")
    model = DQN("MlpPolicy", env, seed=seed, device="cpu", **given)
    start = time.process_time()
    model.learn(steps)
    return float(model.num_timesteps / (time.process_time() - start))


def beside_sb3(steps: int, rounds: int) -> None:
    """Compare trainings on cart-pole."""

    def speed(changes: Any, seed: int) -> float:
        made, seconds, _ = trained(load_task("cartpole"), steps, changes, seed)
        return made / seconds

    ways: dict[str, Callable[[int], float]] = {
        "serp, one such network": lambda seed: speed({"learner": SAME}, seed),
        "sb3 with the same network": lambda seed: sb3(steps, seed, SAME_SB3),
        "serp, defaults": lambda seed: speed(None, seed),
        "sb3, defaults": lambda seed: sb3(steps, seed, {}),
    }
    speeds = np.array([[way(seed) for way in ways.values()] for seed in range(rounds)])
    middle = dict(zip(ways, np.median(speeds, axis=0).tolist(), strict=True))
    for name, value in middle.items():
        print(f"cart-pole, {name}: {value:,.0f} env steps per CPU second")
    ours, theirs, default, their_default = middle.values()
    print(f"serp / sb3: same network {ours / theirs:.2f}, defaults {default / their_default:.2f}")


def several(steps: int, rounds: int) -> None:
    """Train soccer in one environment and in four."""
    speeds = np.zeros((rounds, 2))
    for seed in range(rounds):
        for k, count in enumerate((1, 4)):
            changes = {"training": {"num_envs": count}}
            made, _, wall = trained(load_task("soccer"), steps, changes, seed)
            speeds[seed, k] = made / wall
    one, four = np.median(speeds, axis=0)
    print(f"soccer: 1 environment {one:,.0f}, 4 {four:,.0f} env steps/s, ratio {four / one:.2f}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default="sb3,envs")
    options = parser.parse_args()
    steps, rounds, wanted = options.steps, options.rounds, options.only.split(",")
    if "sb3" in wanted:
        import torch

        torch.set_num_threads(1)
        beside_sb3(steps, rounds)
    if "envs" in wanted:
        several(steps // 3, rounds)


if __name__ == "__main__":
    main()
