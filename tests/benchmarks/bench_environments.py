"""How many env steps a second several environments make, by what a step of the simulator costs.

    python tests/benchmarks/bench_environments.py [--envs 1 4 16] [--env-steps N] [--seed S]

Trains cart-pole with the default preset, with a simulator that takes no more time, one that waits
5 ms in each step (a robot, a simulator elsewhere, a GPU), and one that computes for 5 ms. Prints
env steps per second of wall time, their ratio to a single environment, and the mean return of the
last quarter of the episodes. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from serp._util.processes import one_thread
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.tasks.task import Task

SECONDS = 0.005


def compute(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


KINDS: dict[str, Callable[[float], None] | None] = {
    "as it is": None, "waits 5 ms": time.sleep, "computes 5 ms": compute,
}  # fmt: skip


class Slow(gym.Wrapper[Any, Any, Any, Any]):
    """Takes longer in each step."""

    def __init__(self, env: gym.Env[Any, Any], pause: Callable[[float], None]) -> None:
        super().__init__(env)
        self._pause = pause

    def step(self, action: Any) -> Any:
        self._pause(SECONDS)
        return self.env.step(action)


def slow(task: Task, pause: Callable[[float], None] | None) -> Task:
    if pause is None:
        return task
    make = task.make_env
    return dataclasses.replace(task, make_env=lambda **options: Slow(make(**options), pause))


def measure(task: Task, envs: int, env_steps: int, seed: int) -> tuple[float, float]:
    settings = resolve("default", task.settings, {"training": {"num_envs": envs}})
    with task.bind() as bound, one_thread(), Trainer(bound, settings, seed) as trainer:
        trainer.prepare()
        begun, returns = time.perf_counter(), []
        while trainer.env_steps < env_steps:
            returns += [row.return_ for row in trainer.run()]
        speed = trainer.env_steps / (time.perf_counter() - begun)
    return speed, float(np.mean(returns[-max(1, len(returns) // 4) :]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", default="cartpole")
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--env-steps", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    task = find_task(asked.domain)
    for name, pause in KINDS.items():
        alone = None
        for envs in asked.envs:
            speed, mean = measure(slow(task, pause), envs, asked.env_steps, asked.seed)
            alone = alone or speed
            print(
                f"{name:14} {envs:3} environments: {speed:7.0f} env steps/s, {speed / alone:5.2f} "
                f"times, return {mean:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
