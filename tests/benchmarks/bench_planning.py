"""What one replan costs on the shipped tasks: array lookahead, and planning graph.

    python tests/benchmarks/bench_planning.py [--rounds N] [--tasks cartpole soccer corner-kick]

With the settings and domain files that ship, on states that the planner meets when it plays. All
take turns in short rounds, so that a busy machine slows all alike; medians and fastest rounds are
printed. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import statistics
from collections.abc import Callable
from time import perf_counter
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

from serp.control.arbiter import Arbiter
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import resolve
from serp.tasks.registry import load_task

STATES = 128


def contenders(name: str) -> dict[str, Callable[[], Any]]:
    """Return what is timed, each over all states; playing for them compiles, too."""
    task = load_task(name)
    chosen = resolve("default", task.settings)
    observations, states = [], []
    with task.bind() as bound:
        planner = Lookahead(bound.model, chosen.planner)
        replanner = MonitorReplanner(
            bound.model, depth=chosen.planner.depth, discount=chosen.planner.discount
        )
        arbiter = Arbiter(planner, bound.actions, chosen.arbiter)
        raw, _ = bound.reset(seed=0)
        while len(states) < STATES:
            observations.append(raw)
            states.append(bound.ground(raw))
            raw, _, ended, cut_off, _ = bound.step(arbiter.plan(states[-1]).action)
            if ended or cut_off:
                raw, _ = bound.reset()
        ground = bound.ground
    return {
        f"{name}: grounding": lambda: [ground(raw) for raw in observations],
        f"{name}: lookahead": lambda: [planner.forecast(state) for state in states],
        f"{name}: planning graph": lambda: [replanner.plan(state) for state in states],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--tasks", nargs="+", default=["cartpole", "soccer", "corner-kick"])
    options = parser.parse_args()
    timed = {name: call for task in options.tasks for name, call in contenders(task).items()}
    seconds: dict[str, list[float]] = {name: [] for name in timed}
    for call in timed.values():
        call()  # compiled, allocated
    for _ in range(options.rounds):
        for name, call in timed.items():
            start = perf_counter()
            call()
            seconds[name].append((perf_counter() - start) / STATES)
    for name, found in seconds.items():
        median, best = 1e3 * statistics.median(found), 1e3 * min(found)
        print(f"  {name:<30}{median:>10.3f} ms{best:>10.3f} ms")


if __name__ == "__main__":
    main()
