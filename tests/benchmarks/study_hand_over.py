"""What the trained policy is worth beside planner, learner and other algorithms, as training goes.

    python tests/benchmarks/study_hand_over.py cliff --set learner.members=1 --out runs/cliff.jsonl
    python tests/benchmarks/study_hand_over.py all variants --algorithms serp,dqn,ppo \\
        --seeds 0-9 --out runs/all.jsonl
    python tests/benchmarks/study_hand_over.py --table runs/all.jsonl runs/cliff.jsonl

A task is what `--domain` takes: its name, that of a model variant (`cartpole-reversed`), or a file;
`all` stands for all installed tasks, `variants` for the shipped model variants of them.
Algorithms are those of `serp compare`. One that uses no model trains on the base task alone, and
stands in the rows of its variants too.

Every training is evaluated after exactly each number of env steps, on the same episodes, and goes
on as if it had not been: of `serp` the policies `planner`, `serp` and `learner`; of other
algorithms the greedy choice of the learner (of `mrp` the planner's). With `--out` every algorithm,
seed and point is a JSON line; what the file has is not run again, and the table shows it too.

The table is CSV. A row is a task and point: means over the seeds ± half the width of the 95 %
interval (Student's t), in brackets the lowest. *hand-over* is serp − max(planner, learner),
*others* serp − the best mean of the other algorithms, seed by seed, in per cent of the range from
random actions to the best evaluation on the task and its variants. *training* is the mean return of
all training episodes so far, *steps/s* env steps per second of processor time of the training, *ms*
the time of an evaluated step that the planner decides (medians over the seeds).
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import sys
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from serp._util.processes import one_thread
from serp.agent.decision import Decision
from serp.agent.step_record import StepRecord
from serp.model.transition_model import Vector
from serp.runs.comparison.algorithms import SERP, Algorithm, find_algorithm, merged
from serp.runs.comparison.trial import Arena, Contestant, make_contestant, without_forecast
from serp.runs.rollout import Decide
from serp.settings import Changes
from serp.tasks.registry import find_task, task_entries
from serp.ui.options import parse_settings
from serp_adapters.domains import domain_file

Row = dict[str, Any]
ALONE: Final = ("baseline", "external")
"""Kinds of algorithms without a model; they train on the base task alone."""
SHORT: Final[Changes] = {"planner": {"name": "lookahead", "depth": 1}}
"""For learners alone: their steps are forecast only to count what is unsafe."""


class Training(NamedTuple):
    """One training; its JSON lines have the same fields."""

    task: str
    algorithm: str
    seed: int
    changes: str
    episodes: int


def policies(algorithm: Algorithm, contestant: Contestant) -> dict[str, Decide]:
    """Return the policies to evaluate, by the name of their column."""
    agent, size = contestant.agent, contestant.agent.task.actions.size

    def planner(state: Vector, x: Vector) -> Decision:
        return agent.guarded.plan(state)

    def learner(state: Vector, x: Vector) -> Decision:
        return without_forecast(contestant.greedy(state, x), size)

    if algorithm.name == SERP:
        return {"planner": planner, SERP: agent.decide_greedily, "learner": learner}
    own = {"guided": agent.decide_greedily, "planner": planner}
    return {algorithm.name: own.get(algorithm.kind, learner)}


def rows_of(training: Training, points: Sequence[int], budget: int) -> list[Row]:
    """Train for a number of env steps, and evaluate at every point."""
    warnings.simplefilter("ignore")
    algorithm, task = find_algorithm(training.algorithm), find_task(training.task)
    changes: Changes = parse_settings(training.changes.split())
    changes = merged(changes, SHORT) if algorithm.kind in ALONE else changes
    settings = algorithm.settings(task, changes)
    rows: list[Row] = []
    episodes: list[tuple[int, float, int]] = []
    env_steps, paused = 0, 0.0

    def evaluate() -> None:
        nonlocal paused
        pause = time.process_time()
        row: Row = {**training._asdict(), "point": env_steps}
        row |= {"base": bound.name, "alone": algorithm.kind in ALONE}
        row["steps_per_second"] = env_steps / (pause - begun - paused)
        row |= {"training": [*episodes], "rho": contestant.agent.strategy.rho}
        shown = policies(algorithm, contestant)
        if algorithm.name == SERP and not rows:
            random, size = np.random.default_rng(training.seed), bound.actions.size
            shown["random"] = lambda *_: without_forecast(int(random.integers(size)), size)
        for name, decide in shown.items():
            start = time.process_time()
            played = arena.play(
                decide, training.episodes, policy=name, env_steps=env_steps, trained_in=bound
            )
            row[name] = float(np.mean([each.return_ for each in played]))
            steps = sum(each.length for each in played)
            row[f"{name}_ms"] = 1e3 * (time.process_time() - start) / steps
        rows.append(row)
        paused += time.process_time() - pause

    def on_step(step: StepRecord) -> None:
        nonlocal env_steps
        env_steps += 1
        totals = step.episode
        if step.last:
            episodes.append((env_steps, totals.return_, totals.decisions.unsafe_executed))
        if env_steps in points and (env_steps < budget or algorithm.kind != "external"):
            evaluate()

    with one_thread(), task.bind() as bound:
        contestant = make_contestant(algorithm, bound, settings, training.seed)
        with contextlib.closing(Arena(task, contestant.agent, seed=1_000)) as arena:
            begun = time.process_time()
            contestant.train(budget, on_step)
            if algorithm.kind == "external" and budget in points:
                evaluate()  # it has learned from its last steps too
    return rows


def named(tasks: Iterable[str]) -> list[str]:
    """Return names of tasks, `all` and `variants` replaced by what they stand for."""
    own = sorted(task_entries())
    files = sorted(path.stem for path in domain_file("cartpole").parent.glob("*-*.pddl"))
    others = [name for name in files if name not in own and not name.endswith("-problem")]
    groups = {"all": own, "variants": others}
    return [each for name in tasks for each in groups.get(name, [name])]


def mean(values: Sequence[float]) -> float:
    """Return the mean; −∞ of nothing."""
    return float(np.mean(values)) if values else -np.inf


def cell(values: Sequence[float], lowest: bool = True, digits: int = 4) -> str:
    """Return mean ± half width of its 95 % interval, and the lowest in brackets."""
    from scipy.stats import t

    if len(values) < 2:
        return f"{values[0]:.{digits}g}" if values else "–"
    half = t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5
    text = f"{mean(values):.{digits}g} ± {float(f'{half:.2g}'):g}"
    return f"{text} ({min(values):.4g})" if lowest else text


def share(pairs: Iterable[tuple[float, float]], span: float) -> str:
    """Return the difference of pairs in per cent of a range."""
    percent = [100.0 * (own - other) / span for own, other in pairs]
    return cell(percent, lowest=False, digits=2)


def table(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Yield the rows of the table, its head first."""
    beside = sorted({row["algorithm"] for row in rows} - {SERP})
    shown = ["planner", SERP, "learner", *beside]
    yield ["task", "env steps", "seeds", *shown, "hand-over", "others", "training", "steps/s", "ms"]
    names = ("base", "task", "changes", "point")
    for group in sorted({tuple(row[k] for k in names) for row in rows if SERP in row}):
        base, task, changes, point = group
        of_base = [row for row in rows if row["base"] == base]
        low = mean([row["random"] for row in of_base if "random" in row])
        span = abs(max(row[k] for row in of_base for k in shown if k in row) - low) or 1.0
        alike = ({**row, "task": task} if row["alone"] else row for row in rows)
        here = [row for row in alike if tuple(row[k] for k in names) == group]
        own = [row for row in here if SERP in row]
        values = {k: {row["seed"]: row[k] for row in here if k in row} for k in shown}
        ahead = max((values[k] for k in beside), key=lambda one: mean([*one.values()]), default={})
        training = [mean([each[1] for each in r["training"]]) for r in own if r["training"]]
        cells = [f"{task} {changes}".strip(), f"{point:,}", f"{len(own)}"]
        cells += [cell([*values[k].values()]) for k in shown]
        cells.append(share([(r[SERP], max(r["planner"], r["learner"])) for r in own], span))
        cells.append(share([(r[SERP], ahead[r["seed"]]) for r in own if r["seed"] in ahead], span))
        cells += [cell(training), f"{np.median([row['steps_per_second'] for row in own]):.0f}"]
        yield [*cells, f"{np.median([row['planner_ms'] for row in own]):.2g}"]


def asked(options: argparse.Namespace) -> Iterator[Training]:
    """Yield the trainings of a command, seed by seed; algorithms without a model on base tasks."""
    first, _, last = options.seeds.partition("-")
    for seed in range(int(first), int(last or first) + 1):
        for task in named(options.tasks):
            for name in options.algorithms.split(","):
                on = find_task(task).name if find_algorithm(name).kind in ALONE else task
                yield Training(on or task, name, seed, " ".join(options.changes), options.episodes)


def main() -> int:
    """Run what is not in the file, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*")
    parser.add_argument("--algorithms", default=SERP)
    parser.add_argument("--seeds", default="0-4", help="first-last")
    parser.add_argument("--points", default="500,1000,2000,5000,10000")
    parser.add_argument("--episodes", type=int, default=50, help="of an evaluation")
    parser.add_argument("--set", action="append", default=[], dest="changes")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, nargs="+", help="only print the table of these files")
    options = parser.parse_args()
    points = sorted({int(point) for point in options.points.split(",")})
    files = options.table or ([options.out] if options.out and options.out.exists() else [])
    rows: list[Row] = [json.loads(line) for file in files for line in file.open()]
    there = {(*(row[k] for k in Training._fields), row["point"]) for row in rows}
    wanted, failed = dict.fromkeys([] if options.table else asked(options)), False
    left = {one: [point for point in points if (*one, point) not in there] for one in wanted}
    todo = [(one, missing, points[-1]) for one, missing in left.items() if missing]
    # New processes now and then, because memory of compiled code is never given back.
    for k in range(0, len(todo), 8 * options.jobs):
        with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
            jobs = {pool.submit(rows_of, *job): job for job in todo[k : k + 8 * options.jobs]}
            for job in as_completed(jobs):
                if error := job.exception():
                    failed = True
                    traceback.print_exception(error)
                    print(f"failed: {jobs[job]}", file=sys.stderr)
                    continue
                rows += job.result()
                if options.out is not None:
                    with options.out.open("a") as file:
                        file.writelines(json.dumps(row) + "\n" for row in job.result())
    csv.writer(sys.stdout, lineterminator="\n").writerows(table(rows))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
