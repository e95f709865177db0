"""How many decisions a second the soccer defender makes on one core, resets included.

    python tests/benchmarks/bench_soccer.py [--decisions N] [--rounds N]

Prints the rounds' best and median: on a shared machine the best is what the code can do.
"""

from __future__ import annotations

import argparse
import random
import statistics
import time

import pytest

from serp_envs.soccer import SoccerDefender, engine
from serp_envs.soccer.timing import STEPS_PER_TICK

GOAL = 8000.0
"""Decisions a second that the environment is meant to make."""


def rounds(decisions: int, count: int) -> tuple[list[float], list[float]]:
    """Decisions and physics steps a second of each round, actions drawn at random."""
    env, rng = SoccerDefender(), random.Random(0)
    env.reset(seed=0)
    speeds, physics = [], []
    for _ in range(count):
        actions = rng.choices(range(5), k=decisions)
        ticks = 0
        start = time.perf_counter()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                ticks += env.scenario.world.tick
                env.reset()
        taken = time.perf_counter() - start
        speeds.append(decisions / taken)
        physics.append(STEPS_PER_TICK * ticks / taken)
    return speeds, physics


@pytest.mark.skipif(not engine.NATIVE, reason="this pymunk has the slow way in only")
def test_the_environment_makes_enough_decisions_a_second() -> None:
    assert max(rounds(4000, 8)[0]) >= GOAL


def main() -> None:
    """Print the speeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--decisions", type=int, default=4000, help="a round")
    parser.add_argument("--rounds", type=int, default=8)
    arguments = parser.parse_args()
    speeds, physics = rounds(arguments.decisions, arguments.rounds)
    for name, values in (("decisions/s", speeds), ("physics steps/s", physics)):
        print(f"{name:16} best {max(values):8.0f}   median {statistics.median(values):8.0f}")


if __name__ == "__main__":
    main()
