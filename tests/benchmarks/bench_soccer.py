"""What a decision costs in the soccer scenarios: the environment, the grounding, the planner.

    python tests/benchmarks/bench_soccer.py [--decisions N] [--rounds N]

On one core. Environment: decisions a second with actions drawn at random, resets (at soccer with
the approach before a contest) included. Planner: a replan in the lookahead form, with the settings
and the domain file that ship, on the states that it meets when it plays. All contenders take turns
in short rounds, so that a busy machine slows all alike; medians and best rounds are printed beside
what is wanted. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import random
import statistics
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from serp.control.arbiter import Arbiter
from serp.planning.lookahead import Lookahead
from serp.settings import resolve
from serp.tasks.registry import load_task
from serp_envs.soccer import CornerKickDefender, SoccerDefender
from serp_envs.soccer.environment import SoccerEnv
from serp_envs.soccer.physics import pymunk_interface as engine
from serp_envs.soccer.physics.periods import STEPS_PER_TICK

TASKS: dict[str, Callable[[], SoccerEnv]] = {
    "soccer": SoccerDefender,
    "corner-kick": CornerKickDefender,
}
STATES = 256


class Environment:
    """One of them, played at random."""

    def __init__(self, name: str, decisions: int) -> None:
        """Reset; the same decisions in every run of the program."""
        self._env, self._rng, self._decisions = TASKS[name](), random.Random(0), decisions
        self._env.reset(seed=0)
        self.decisions: list[float] = []
        """Decisions a second of each round."""
        self.physics: list[float] = []
        """Physics steps a second of each round."""

    def measure(self) -> None:
        """Play a round."""
        env = self._env
        actions = self._rng.choices(range(len(env.scenario.actions)), k=self._decisions)
        ticks = -env.scenario.world.tick  # played already
        start = time.perf_counter()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                ticks += env.scenario.world.tick
                env.reset()
        taken = time.perf_counter() - start
        ticks += env.scenario.world.tick
        self.decisions.append(self._decisions / taken)
        self.physics.append(STEPS_PER_TICK * ticks / taken)


class Planning:
    """Grounding and replanning, on the states that the planner meets when it plays."""

    def __init__(self, name: str) -> None:
        """Play; that compiles, too."""
        task = load_task(name)
        chosen = resolve("default", task.settings)
        with task.bind() as bound:
            planner = Lookahead(bound.model, chosen.planner)
            arbiter = Arbiter(planner, bound.actions, chosen.arbiter)
            found: list[Any] = []
            raw, _ = bound.reset(seed=0)
            while len(found) < STATES:
                found.append(raw)
                action = arbiter.plan(bound.ground(raw)).action
                raw, _, terminated, truncated, _ = bound.step(action)
                if terminated or truncated:
                    raw, _ = bound.reset()
            self._observations = found
            self._states = [np.array(bound.ground(raw)) for raw in found]
            self._ground, self._plan = bound.ground, planner.forecast
        self.plan: list[float] = []
        """Seconds a replan, of each round."""
        self.ground: list[float] = []
        """Seconds an observation, of each round."""

    def measure(self) -> None:
        """Ground and replan every state."""
        start = time.perf_counter()
        for state in self._states:
            self._plan(state)
        between = time.perf_counter()
        for raw in self._observations:
            self._ground(raw)
        self.plan.append((between - start) / STATES)
        self.ground.append((time.perf_counter() - between) / STATES)


def row(name: str, median: str, best: str, wanted: str = "") -> None:
    """Print a line."""
    print(f"  {name:<28}{median:>14}{best:>14}   {wanted}".rstrip())


def rate(name: str, values: list[float], wanted: str = "") -> None:
    """Print how often a second something happens."""
    row(name, f"{statistics.median(values):,.0f} /s", f"{max(values):,.0f} /s", wanted)


def duration(name: str, values: list[float], wanted: str = "") -> None:
    """Print how long something takes."""
    row(name, f"{1e3 * statistics.median(values):.3f} ms", f"{1e3 * min(values):.3f} ms", wanted)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--decisions", type=int, default=4000, help="a round")
    parser.add_argument("--rounds", type=int, default=9)
    arguments = parser.parse_args()
    worlds = {name: Environment(name, arguments.decisions) for name in TASKS}
    planners = {name: Planning(name) for name in TASKS}
    for _ in range(arguments.rounds):
        for contender in (*worlds.values(), *planners.values()):
            contender.measure()
    slow = "" if engine.NATIVE else "; this pymunk has the slow way in only"
    print(f"{arguments.rounds} interleaved rounds of {arguments.decisions} decisions{slow}\n")
    for name in TASKS:
        row(name, "median", "best")
        rate("decisions", worlds[name].decisions, "wanted: ≥ 8,000 /s")
        rate("physics steps", worlds[name].physics)
        duration("replan, lookahead", planners[name].plan, "wanted: ≤ 0.3 ms")
        duration("grounding", planners[name].ground)


if __name__ == "__main__":
    main()
