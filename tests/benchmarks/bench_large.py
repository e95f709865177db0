"""What a replan costs in classical domains of about 16 objects: blocks, gripper, logistics.

    python -m tests.benchmarks.bench_large [--rounds N] [--depth D]

Seconds from the text to the model, to the first decision of a new lookahead (loops are compiled
before), and of each replan along a walk through the domain; and the same of the planner
`far-sight`. Nothing is asserted. Run it with the code before and after a change, by turns.
"""

from __future__ import annotations

import argparse
import statistics
import warnings
from time import perf_counter

import numpy as np

from serp.control.registry import make_planner
from serp.model.loading import Domain
from serp.model.transition_model import Vector
from serp.settings import PlannerSettings, resolve
from tests.generated import load_texts
from tests.generated.classical import blocks, gripper, logistics


def walk(domain: Domain, steps: int) -> list[Vector]:
    """Return the states on a random walk."""
    model, random = domain.model, np.random.default_rng(0)
    assert model.initial_state is not None
    states = [model.initial_state]
    while len(states) < steps:
        action = int(random.integers(len(model.actions)))
        target, flags = model.transition(states[-1].tolist(), action)
        if flags & 1:
            states.append(np.array(target[:-1]))
    return states


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--depth", type=int, default=3)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    near = PlannerSettings(depth=options.depth)
    far = resolve("default").planner.replace(name="far-sight")
    small = load_texts(blocks(1))
    for settings in (near, far):
        make_planner(small.model, settings).forecast(np.zeros(len(small.model.fluents)))
    for name, texts in {
        "blocks": blocks(16), "gripper": gripper(12), "logistics": logistics(4, 8),
    }.items():  # fmt: skip
        start = perf_counter()
        domain = load_texts(texts, limit=50_000)
        model = domain.model
        loading = perf_counter() - start
        states = walk(domain, options.rounds + 1)
        start = perf_counter()
        planner = make_planner(model, near)
        planner.forecast(states[0])
        first = perf_counter() - start
        times = []
        for state in states[1:]:
            start = perf_counter()
            planner.forecast(state)
            times.append(perf_counter() - start)
        start = perf_counter()
        seeing = make_planner(model, far)
        seeing.forecast(states[0])
        whole = perf_counter() - start
        print(
            f"{name:<10}{len(model.actions):>5} actions{len(model.fluents):>5} fluents"
            f"  load {loading:.3f} s  first {first:.3f} s"
            f"  replan {1e3 * statistics.median(times):.2f} ms  first decision {whole:.2f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
