"""What a decision of an exported policy costs: those of the learner, and those that need a plan.

    python tests/benchmarks/bench_export.py RUN [--steps N] [--seed N]

RUN is a folder of plan-and-learn. The policy is exported, the run is played by serp, and the
controller decides beside it. Printed are the time of a decision, median and 99th percentile, in µs,
and how many decisions differ from those of serp.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

import serp
from serp.runs.controller import Controller
from serp.runs.evaluation import play


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--steps", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    run = serp.load_run(given.run)
    times: dict[str, list[float]] = {"accepted proposals": [], "plans": []}
    differ = 0
    with tempfile.TemporaryDirectory() as folder, run.environment() as task:
        controller = Controller(serp.export_policy(run, Path(folder) / "policy"))
        episodes = play(run.agent, task, episodes=given.steps, seed=given.seed)
        steps = (step for episode in episodes for step in episode.steps)
        for step in itertools.islice(steps, given.steps):
            observation = task.observation(step.observation)
            begin = perf_counter()
            found = controller.decide(observation, state=step.state)
            taken = 1e6 * (perf_counter() - begin)
            times["accepted proposals" if found.executed_by == "learner" else "plans"].append(taken)
            of_run = step.decision.action, step.decision.reason, step.decision.executed_by
            differ += (found.action, found.reason, found.executed_by) != of_run
    print(f"{differ} of {given.steps} decisions differ")
    for kind, each in times.items():
        if each:
            median, late = np.percentile(each, (50, 99))
            print(f"{kind}: {len(each)}, median {median:.0f} µs, 99 % within {late:.0f} µs")


if __name__ == "__main__":
    main()
