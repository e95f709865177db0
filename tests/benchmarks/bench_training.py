"""How many env steps a second a whole training makes, beside stable-baselines3's DQN.

    python tests/benchmarks/bench_training.py [--rounds N] [--env-steps N]

Cart-pole, one core, one update a step, batch 64, network 64-64, learning from step 200 on. serp
plans five actions deep in every step, arbitrates, explains every veto, and writes its run folder:
decision log, metrics, checkpoints; all counts but compilation (cached) and the pictures at the
end. stable-baselines3 has its defaults otherwise, and writes nothing. All take turns, so that a
busy machine slows all alike; medians and ratios are printed. Nothing is asserted.

Printed as well: the preset `default` as users have it (an ensemble, two periods an edge).
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium as gym
import torch

import serp
from serp.tasks.registry import load_task

HIDDEN, BATCH, STARTS, WANTED = (64, 64), 64, 200, 3.0
EQUAL: dict[str, dict[str, Any]] = {
    "planner": {"depth": 5},
    "learner": {
        "hidden": HIDDEN,
        "batch_size": BATCH,
        "learning_starts": STARTS,
        "updates_per_step": 1.0,
        "members": 1,
        "layer_norm": False,
    },
}


def with_serp(settings: dict[str, dict[str, Any]], env_steps: int, seed: int) -> float:
    """Env steps a second of `plan_and_learn`."""
    with tempfile.TemporaryDirectory() as folder:
        run = serp.plan_and_learn(
            load_task("cartpole"),
            settings=settings,
            env_steps=env_steps,
            seed=seed,
            out=Path(folder) / "run",
            quiet=True,
        )
        return float(run.metrics["env_steps"][-1] / run.metrics["wall_time"][-1])


def with_stable_baselines3(env_steps: int, seed: int) -> float:
    """Env steps a second of its DQN."""
    from stable_baselines3 import DQN

    agent = DQN(
        "MlpPolicy",
        gym.make("serp_envs:serp/CartPole-v0"),
        batch_size=BATCH,
        learning_starts=STARTS,
        train_freq=1,
        gradient_steps=1,
        policy_kwargs={"net_arch": list(HIDDEN)},
        device="cpu",
        seed=seed,
    )
    start = perf_counter()
    agent.learn(total_timesteps=env_steps)
    return env_steps / (perf_counter() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--env-steps", type=int, default=5_000)
    arguments = parser.parse_args()
    steps = arguments.env_steps
    torch.set_num_threads(1)
    contenders: dict[str, Callable[[int], float]] = {
        "stable-baselines3 DQN": lambda seed: with_stable_baselines3(steps, seed),
        "serp, the same network": lambda seed: with_serp(EQUAL, steps, seed),
        "serp, preset default": lambda seed: with_serp({}, steps, seed),
    }
    with_serp(EQUAL, 300, 0)  # compiled from here on
    rates: dict[str, list[float]] = {name: [] for name in contenders}
    for seed in range(arguments.rounds):
        for name, measure in contenders.items():
            rates[name].append(measure(seed))
    base = statistics.median(rates["stable-baselines3 DQN"])
    print(f"{steps:,} env steps of cart-pole, medians of {arguments.rounds} interleaved rounds\n")
    for name, found in rates.items():
        median = statistics.median(found)
        wanted = f"wanted: ≥ {WANTED:g} ×" if name == "serp, the same network" else ""
        print(f"  {name:<26}{median:>8,.0f} env steps/s   {median / base:>5.1f} ×   {wanted}")


if __name__ == "__main__":
    main()
