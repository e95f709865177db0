"""What learning side by side saves: several seeds in one pass beside one after the other.

    python tests/benchmarks/bench_side_by_side.py [--rounds N] [--seeds 1,2,5,10] [--only TEXT]

A seed-step is `DQN.remember` and one gradient update (batch 64, network 64-64, 4 inputs, 2 actions,
Polyak target, one core) of one seed; no environment, no planner. Below that stand whole trainings
of `serp compare` on cart-pole: planner, vetoes and environment included, in the settings of the
algorithm. Both ways take turns in short rounds, so that a busy machine slows both alike. Printed
are medians of CPU time, the median of the ratios of neighbouring rounds, and that both ways end in
the same bits.
"""

from __future__ import annotations

import argparse
import os
import statistics
from collections.abc import Callable, Iterator
from time import process_time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import torch

from serp.comparison.algorithms import find_algorithm
from serp.comparison.contender import Own
from serp.comparison.trial import trial_settings
from serp.learning import DQN, DQNSettings, SideBySide
from serp.learning.symmetry import Element, SymmetryGroup
from serp.registry import load_task
from serp.training import LearningPoints

INPUTS, ACTIONS, FILLED, STEPS = 4, 2, 1000, 200
MIRROR = Element(tuple(range(INPUTS)), (-1.0,) * INPUTS, (1, 0))
RECIPES: dict[str, dict[str, Any]] = {
    "1 member": {},
    "1 member, LayerNorm, symmetry": {"layer_norm": True, "symmetry": True},
    "3 members": {"members": 3},
    "3 members, LayerNorm, symmetry": {"members": 3, "layer_norm": True, "symmetry": True},
}
TRAININGS: dict[str, tuple[str, dict[str, Any]]] = {
    "training serp": ("serp", {}),
    "training serp, 3 members": ("serp", {"learner": {"members": 3}}),
    "training serp, 1 member": ("serp", {"learner": {"members": 1}}),
    "training serp-paper": ("serp-paper", {}),
}


class Seeds:
    """Learners that live through the same transitions.

    Args:
        count: How many.
        recipe: Settings.
        beside: Learn side by side.
    """

    def __init__(self, count: int, recipe: dict[str, Any], beside: bool) -> None:
        rng = np.random.default_rng(0)
        self.x = rng.standard_normal((FILLED + 1, INPUTS)).astype(np.float32)
        self.actions = rng.integers(ACTIONS, size=FILLED).tolist()
        self.rewards = rng.standard_normal(FILLED).tolist()
        settings = DQNSettings(target_period=None, target_polyak=0.005, **recipe)
        group = SymmetryGroup(INPUTS, ACTIONS, [MIRROR])
        self.agents = [DQN(INPUTS, ACTIONS, settings, seed, group) for seed in range(count)]
        self.now = 0
        for _ in range(FILLED):
            self.remember()
        self.learn: Callable[[], Any] = self.one_after_the_other
        if beside:
            self.learn = SideBySide(self.agents).learn

    def one_after_the_other(self) -> None:
        for agent in self.agents:
            agent.learn()

    def remember(self) -> None:
        i = self.now % FILLED
        self.now += 1
        for agent in self.agents:
            agent.remember(
                self.x[i], self.actions[i], self.rewards[i], self.x[i + 1], i % 50 == 49, False
            )

    def seconds(self) -> float:
        """Of one seed-step."""
        steps = max(STEPS // len(self.agents), 10)
        start = process_time()
        for _ in range(steps):
            self.remember()
            self.learn()
        return (process_time() - start) / steps / len(self.agents)


class Trainings:
    """Trainings of an algorithm of `serp compare` on cart-pole, from seed 0 on.

    Args:
        count: How many.
        name: The algorithm.
        changes: What is changed in its settings.
        beside: Learn side by side.
    """

    def __init__(self, count: int, name: str, changes: dict[str, Any], beside: bool) -> None:
        algorithm, task = find_algorithm(name), load_task("cartpole")
        settings = trial_settings(algorithm, task, changes)
        owns = [Own(algorithm, task.bind(), settings, seed) for seed in range(count)]
        self.agents = [own.agent.learner for own in owns]
        self.points: list[LearningPoints[None]] = [
            own.learning_points(10**9, lambda transition: None) for own in owns
        ]
        for points in self.points:
            next(points)
        self.beside = SideBySide(self.agents) if beside else None
        self.go(max(settings.learner.learning_starts, 300))  # memories hold something to draw

    def go(self, steps: int) -> None:
        """Make so many env steps of each seed."""
        if self.beside is not None:
            for _ in range(steps):
                losses = self.beside.learn()
                for points, loss in zip(self.points, losses, strict=True):
                    points.send(loss)
            return
        for points, learner in zip(self.points, self.agents, strict=True):
            for _ in range(steps):
                points.send(learner.learn())

    def seconds(self) -> float:
        """Of one env step of one seed, with all that belongs to it."""
        steps = max(STEPS // len(self.agents), 10)
        start = process_time()
        self.go(steps)
        return (process_time() - start) / steps / len(self.agents)


def same_bits(one: Seeds | Trainings, other: Seeds | Trainings) -> bool:
    for agent, twin in zip(one.agents, other.agents, strict=True):
        arrays, of_twin = agent.state_dict()[0], twin.state_dict()[0]
        if any(not np.array_equal(array, of_twin[name]) for name, array in arrays.items()):
            return False
    return True


def pairs(
    counts: list[int], only: str
) -> Iterator[tuple[str, Seeds | Trainings, Seeds | Trainings]]:
    """What is measured: a name, one after another, side by side."""
    for name, recipe in RECIPES.items():
        for count in counts if only in name else ():
            yield name, Seeds(count, recipe, False), Seeds(count, recipe, True)
    for name, made_of in TRAININGS.items():
        for count in counts if only in name else ():
            yield name, Trainings(count, *made_of, False), Trainings(count, *made_of, True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--seeds", default="1,2,5,10")
    parser.add_argument("--only", default="", help="text in the names, such as `training`")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{'µs a seed-step':32}{'seeds':>6}{'alone':>8}{'beside':>8}{'times':>7}  same bits")
    counts = list(map(int, arguments.seeds.split(",")))
    for name, alone, beside in pairs(counts, arguments.only):
        alone.seconds(), beside.seconds()  # compiles, fills caches
        rounds = [(alone.seconds(), beside.seconds()) for _ in range(arguments.rounds)]
        one, other = (statistics.median(times) * 1e6 for times in zip(*rounds, strict=True))
        times = statistics.median(a / b for a, b in rounds)
        print(
            f"{name:32}{len(alone.agents):6}{one:8.0f}{other:8.0f}{times:7.2f}  "
            f"{same_bits(alone, beside)}"
        )
    print(f"times: as many times faster side by side, medians of {arguments.rounds} rounds")


if __name__ == "__main__":
    main()
