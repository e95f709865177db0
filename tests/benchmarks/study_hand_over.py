"""What the trained policy is worth beside planner and learner, at several times of a training.

    python tests/benchmarks/study_hand_over.py cliff taxi --seeds 0-9 --points 500,1000,2000,5000
    python tests/benchmarks/study_hand_over.py soccer --seeds 0-4 --set learner.members=3

Every training stops at each number of env steps; the policies `planner`, `serp` and `learner` are
evaluated on the same episodes, and the training goes on as if they had not been. A row a task and
time: mean over the seeds with the half width of its 95 % interval (Student's t), in brackets the
lowest; the mean return of the training so far; env steps per second of processor time of the
training; milliseconds of a decision of the planner. With `--out` every seed is a JSON line.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch

from serp.cli.options import parse_settings
from serp.settings import resolve
from serp.tasks.registry import find_task
from serp.training.evaluation import evaluate
from serp.training.policies import Policy
from serp.training.trainer import Trainer

Row = dict[str, Any]
SHOWN: tuple[Policy, ...] = ("planner", "serp", "learner")


def rows_of(name: str, seed: int, points: list[int], episodes: int, changes: Any) -> list[Row]:
    """Train on a task with a seed, and evaluate at every point."""
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    task = find_task(name)
    settings = resolve("default", task.settings, changes)
    with task.bind() as bound, task.bind() as other:
        trainer = Trainer(bound, settings, seed)
        trainer.prepare()
        return list(_rows(trainer, other, name, seed, points, episodes))


def _rows(
    trainer: Trainer, other: Any, name: str, seed: int, points: list[int], episodes: int
) -> Iterator[Row]:
    spent, returns = 0.0, []
    for point in points:
        begun = time.process_time()
        while trainer.env_steps < point:
            returns.append(float(trainer.run_episode().return_))
        spent += time.process_time() - begun
        saved = trainer.state_dict()
        row: Row = {"task": name, "seed": seed, "point": point, "env_steps": trainer.env_steps}
        row |= {"training": float(np.mean(returns)), "steps_per_second": trainer.env_steps / spent}
        for policy in SHOWN:
            begun = time.process_time()
            result = evaluate(trainer.agent, other, policy, episodes=episodes, seed=1_000)
            steps = sum(result.lengths)
            row[policy] = result.mean
            row[f"{policy}_ms"] = 1e3 * (time.process_time() - begun) / steps
        row["rho"] = trainer.agent.strategy.rho
        trainer.load_state_dict(*saved)
        yield row


def spread(values: list[float]) -> str:
    """Mean ± half width of its 95 % interval (lowest)."""
    from scipy.stats import t

    mean = float(np.mean(values))
    if len(values) < 2:
        return f"{mean:.4g}"
    half = float(t.ppf(0.975, len(values) - 1)) * float(np.std(values, ddof=1)) / len(values) ** 0.5
    return f"{mean:.4g} ± {half:.2g} ({min(values):.4g})"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="+")
    parser.add_argument("--seeds", default="0-4", help="first-last")
    parser.add_argument("--points", default="500,1000,2000,5000,10000")
    parser.add_argument("--episodes", type=int, default=50, help="of an evaluation")
    parser.add_argument("--set", action="append", default=[], dest="changes")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    points = [int(point) for point in options.points.split(",")]
    changes = parse_settings(options.changes)
    print("| task | env steps | planner | serp | learner | training | steps/s | planner, ms |")
    print("|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.jobs) as pool:
        for task in options.tasks:
            under_way = [
                pool.submit(rows_of, task, seed, points, options.episodes, changes)
                for seed in seeds
            ]
            rows = [row for job in under_way for row in job.result()]
            if options.out is not None:
                with options.out.open("a") as file:
                    file.writelines(json.dumps(row) + "\n" for row in rows)
            for point in points:
                here = [row for row in rows if row["point"] == point]
                cells = [spread([row[policy] for row in here]) for policy in SHOWN]
                speed, ms = (
                    float(np.median([row[key] for row in here]))
                    for key in ("steps_per_second", "planner_ms")
                )
                training = spread([row["training"] for row in here])
                print(
                    f"| {task} | {point} | {' | '.join(cells)} | {training} | {speed:.0f} "
                    f"| {ms:.2g} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
