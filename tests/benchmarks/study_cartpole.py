"""How fast the learner alone becomes good on cart-pole, and what it costs: a study over seeds.

    python tests/benchmarks/study_cartpole.py --preset default --seeds 0-9 --env-steps 20000

Every 1,000 env steps of training, the greedy learner is evaluated alone, without planner and veto,
for 10 episodes. Printed for each seed and as medians: the first such checkpoint with a mean return
of at least 475, the share of later checkpoints that reach it as well, and the falls in training.
`--set arbiter.rho=1.0` changes a setting, `--json FILE` keeps every number.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

EVERY = 1_000
EPISODES = 10
SOLVED = 475.0
EVALUATION_SEED = 99


def study(preset: str, changes: dict[str, dict[str, Any]], seed: int, steps: int) -> dict[str, Any]:
    import threadpoolctl
    import torch

    from serp.evaluation import evaluate
    from serp.registry import load_task
    from serp.settings import resolve
    from serp.training import Trainer

    torch.set_num_threads(1)
    task = load_task("cartpole")
    settings = resolve(preset, task.settings, changes)
    evaluation_task = task.bind()
    trainer = Trainer(task.bind(), settings, seed)
    greedy: list[float] = []
    evaluating = 0.0

    def on_step() -> None:
        nonlocal evaluating
        if trainer.env_steps % EVERY == 0 and trainer.env_steps <= steps:
            start = time.perf_counter()
            result = evaluate(
                trainer.agent,
                evaluation_task,
                "learner",
                episodes=EPISODES,
                seed=EVALUATION_SEED,
            )
            greedy.append(result.mean)
            evaluating += time.perf_counter() - start

    trainer.on_step = on_step
    rows = []
    start = time.perf_counter()
    with threadpoolctl.threadpool_limits(1):
        while trainer.env_steps < steps:
            rows.append(trainer.run_episode())
    seconds = time.perf_counter() - start - evaluating
    solved = [k for k, value in enumerate(greedy) if value >= SOLVED]
    later = [value >= SOLVED for value in greedy[solved[0] :]] if solved else []
    return {
        "seed": seed,
        "solved_at": (solved[0] + 1) * EVERY if solved else None,
        "later_solved": sum(later) / len(later) if later else None,
        "falls": sum(row.terminated for row in rows),
        "first_10_returns": statistics.fmean(row.return_ for row in rows[:10]),
        "unsafe_executed": sum(row.unsafe_executed for row in rows),
        "final_greedy": greedy[-1],
        "steps_per_second": trainer.env_steps / seconds,
        "greedy": greedy,
        "returns": [row.return_ for row in rows],
    }


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _changes(items: list[str]) -> dict[str, dict[str, Any]]:
    changes: dict[str, dict[str, Any]] = {}
    for item in items:
        name, _, value = item.partition("=")
        section, _, setting = name.partition(".")
        changes.setdefault(section, {})[setting] = json.loads(value)
    return changes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--preset", default="default")
    parser.add_argument("--seeds", default="0-9", type=_seeds)
    parser.add_argument("--env-steps", default=20_000, type=int)
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=JSON")
    parser.add_argument("--jobs", default=os.cpu_count(), type=int)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    changes = _changes(options.set)
    columns = ("seed", "solved_at", "later_solved", "falls", "final_greedy", "first_10_returns")
    print("  ".join(f"{c:>16}" for c in columns), flush=True)
    results = []
    with ProcessPoolExecutor(options.jobs) as pool:
        count = len(options.seeds)
        for result in pool.map(
            study,
            [options.preset] * count,
            [changes] * count,
            options.seeds,
            [options.env_steps] * count,
        ):
            results.append(result)
            print("  ".join(f"{_shown(result[c]):>16}" for c in columns), flush=True)
    never = sum(r["solved_at"] is None for r in results)
    at = sorted(r["solved_at"] if r["solved_at"] is not None else float("inf") for r in results)
    reached = [v >= SOLVED for r in results for v in _from_solved(r)]
    print(f"solved at: median {statistics.median(at):g} env steps, range {at[0]:g} to {at[-1]:g}")
    print(f"never solved: {never} of {len(results)}")
    if reached:
        print(f"later checkpoints >= {SOLVED:g}: {sum(reached)} of {len(reached)}")
    falls = sorted(r["falls"] for r in results)
    middle = statistics.median(falls)
    print(f"falls in training: median {middle:g}, range {falls[0]} to {falls[-1]}")
    print(f"unsafe executed: {sum(r['unsafe_executed'] for r in results)}")
    speed = statistics.median(r["steps_per_second"] for r in results)
    print(f"env steps/s of one process: median {speed:.0f}")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n")


def _from_solved(result: dict[str, Any]) -> list[float]:
    """Return the greedy returns from the first checkpoint that counts as solved."""
    if result["solved_at"] is None:
        return []
    greedy: list[float] = result["greedy"]
    return greedy[result["solved_at"] // EVERY - 1 :]


def _shown(value: Any) -> str:
    if value is None:
        return "never"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
