"""How fast trainings and commands are.

    python -m tests.benchmarks.bench_training [--steps 3000] [--rounds 3]
        [--only sb3,others,envs,commands]

`sb3`: env steps per second of processor time on cart-pole, beside the DQN of stable-baselines3 with
the same network, batch and updates, and with its defaults. `others`: the same on Pendulum-v1 with
controllers as actions and with 225 actions, and milliseconds a step without the environment's own.
`envs`: soccer, env steps per second of wall time with 1 and 4 environments. `commands`: wall time
of `serp list`, `check`, `plan` and `why` as processes, the first one and the median of the rounds.
What is compared takes turns; medians of the rounds. One thread, as torch has it here.
"""

from __future__ import annotations

import argparse
import dataclasses
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import serp
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import custom_task, load_task

ROOT = Path(__file__).parents[2]
SAME: dict[str, Any] = {
    "hidden": (64, 64), "members": 1, "layer_norm": False, "batch_size": 64,
    "updates_per_step": 1.0, "learning_starts": 200,
}  # fmt: skip
SAME_SB3: dict[str, Any] = {
    "policy_kwargs": {"net_arch": [64, 64]}, "batch_size": 64, "train_freq": 1,
    "gradient_steps": 1, "learning_starts": 200,
}  # fmt: skip
POINT = """(define (domain point) (:requirements :numeric-fluents :time)
(:functions (x) (y) (vx) (vy) (reward)) {actions}
(:process along :parameters () :precondition (and)
 :effect (and (increase (x) (* #t (vx))) (increase (y) (* #t (vy)))))
(:event far :parameters () :precondition (and)
 :effect (and (decrease (reward) (+ (* (x) (x)) (* (y) (y)))))))
"""
"""A point that 15 × 15 thrusts move to the middle."""


class Clocked(gym.Wrapper[Any, Any, Any, Any]):
    """Adds up the processor time of the environment that it wraps."""

    seconds = 0.0

    def step(self, action: Any) -> Any:
        start = time.process_time()
        answer = self.env.step(action)
        Clocked.seconds += time.process_time() - start
        return answer


class Point(gym.Env[Any, int]):
    """The world of `POINT`, with drag, which the file leaves out."""

    observation_space = gym.spaces.Box(-100.0, 100.0, (4,), np.float64)
    action_space = gym.spaces.Discrete(225)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.state, self.count = self.np_random.uniform(-1, 1, 4), 0
        return self.state.copy(), {}

    def step(self, action: int) -> Any:
        thrust = np.array(divmod(int(action), 15)) / 7.0 - 1.0
        self.state[2:] += 0.1 * (thrust - 0.2 * self.state[2:])
        self.state[:2] += 0.1 * self.state[2:]
        self.count += 1
        return (
            self.state.copy(),
            -float(self.state[:2] @ self.state[:2]),
            False,
            self.count > 99,
            {},
        )


def tasks_of_others(folder: Path) -> dict[str, serp.Task]:
    """Return Pendulum with controllers, and the point."""
    thrusts = [(k // 15 - 7, k % 15 - 7) for k in range(225)]
    actions = "".join(
        f"(:action thrust-{k} :parameters () :precondition (and) :effect (and"
        f" (increase (vx) {x / 70}) (increase (vy) {y / 70})))\n"
        for k, (x, y) in enumerate(thrusts)
    )
    (folder / "point.pddl").write_text(POINT.format(actions=actions), encoding="utf-8")
    point = serp.Task(
        name="point", domain=folder / "point.pddl", ground=np.asarray, reward="environment",
        make_env=Point, actions={f"thrust-{k}": k for k in range(225)}, dt=0.1,
    )  # fmt: skip
    pendulum = custom_task(str(ROOT / "docs" / "examples" / "pendulum.py"))
    return {"Pendulum-v1, 4 controllers": pendulum, "a point, 225 actions": point}


def trained(task: serp.Task, steps: int, changes: Any = None, seed: int = 0) -> tuple[float, ...]:
    """Train; return env steps, seconds of processor time and of wall time."""
    with task.bind() as bound:
        settings = resolve("default", bound.task.settings, changes)
        with Trainer(bound, settings, seed) as trainer:
            Clocked.seconds, wall, start = 0.0, time.perf_counter(), time.process_time()
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


def others(folder: Path, steps: int) -> None:
    """Train on tasks of others."""
    for name, task in tasks_of_others(folder).items():
        make = task.make_env
        clocked = dataclasses.replace(task, make_env=lambda make=make: Clocked(make()))
        made, seconds, _ = trained(clocked, steps)
        own = Clocked.seconds
        print(
            f"{name}: {made / seconds:,.0f} env steps per CPU second; a step without the "
            f"environment {1e3 * (seconds - own) / made:.2f} ms, environment "
            f"{1e3 * own / made:.2f} ms"
        )


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


def commands(folder: Path, rounds: int) -> None:
    """Run commands."""
    run = str(folder / "run")
    lines = {"list": ["list"], "check": ["check", "cartpole"],
             "plan": ["plan", "--domain", "cartpole"], "why": ["why", run]}  # fmt: skip
    train = ["plan-and-learn", "--domain", "cartpole", "--env-steps", "300", "--out", run]
    called([*train, "--quiet"])
    times = {name: [called(line) for _ in range(rounds + 1)] for name, line in lines.items()}
    for name, seconds in times.items():
        print(f"serp {name}: first {seconds[0]:.2f} s, then {np.median(seconds[1:]):.2f} s")


def called(line: list[str]) -> float:
    """Run a command; return the seconds of wall time."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "serp", *line], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default="sb3,others,envs,commands")
    options = parser.parse_args()
    steps, rounds, wanted = options.steps, options.rounds, options.only.split(",")
    if "sb3" in wanted:
        import torch

        torch.set_num_threads(1)
        beside_sb3(steps, rounds)
    with tempfile.TemporaryDirectory() as name:
        if "others" in wanted:
            others(Path(name), steps // 3)
        if "envs" in wanted:
            several(steps // 3, rounds)
        if "commands" in wanted:
            commands(Path(name), rounds)


if __name__ == "__main__":
    main()
