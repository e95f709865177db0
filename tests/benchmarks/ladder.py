"""The ladder: what SErP is worth after 500, 2,000 and 5,000 env steps, and each of its mechanisms.

    python -m tests.benchmarks.ladder --points 2000 --out new.csv --against docs/results/ladder.csv
    python -m tests.benchmarks.ladder taxi cliff --without slack --without n-step
    python -m tests.benchmarks.ladder --mechanisms --seeds 0-2 --out docs/results/mechanisms.csv

Tasks are named as for `--domain`; without any, all installed tasks and the shipped variants whose
files are wrong, partial or empty. Every training is evaluated after exactly each number of env
steps, on the same episodes, and goes on as if it had not been. `--out` is written after every
training, and what it has is not run again.

A row of the CSV is a task, seed and point: mean returns of `planner`, `serp`, `learner` (without
veto), `random` actions, and of all episodes of the `training` so far; env steps so far that were
flagged `unsafe`, flagged while another action was not (`avoidable_unsafe`), and that came out
unsafe (`unsafe_observed`); env steps per second of processor time of the training; milliseconds
of processor time of a decision of the planner.

`--without` switches a mechanism off; several together. `--against` compares with another file, seed
by seed: mean differences with 95 % intervals (Student's t) in per cent of the task's range, from
random actions to the best mean of a policy in that file. `*`: beyond noise. `--mechanisms` switches
one after another off, and prints what each is worth. `--print` runs nothing.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import inspect
import json
import os
import sys
import time
import traceback
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.registry import find_task, task_entries

Row = dict[str, Any]
ROOT: Final = Path(__file__).parents[2]
POLICIES: Final = ("planner", "serp", "learner")
COMPARED: Final = (*POLICIES, "training")
COUNTS: Final = ("unsafe", "avoidable_unsafe", "unsafe_observed")
COLUMNS: Final = (
    "without", "task", "seed", "env_steps", *POLICIES, "random", "training", "episodes", *COUNTS,
    "steps_per_cpu_second", "ms_per_decision",
)  # fmt: skip
EPISODES: Final = {
    "acrobot": 5, "cliff": 30, "corner-kick": 40, "frozen-lake": 100, "hill": 20, "soccer": 40,
    "taxi": 30,
}  # fmt: skip
"""Episodes of an evaluation, 10 of other tasks: more where returns vary, fewer where they last."""
NOTICED, LARGE = 1.0, 20.0
"""Per cent of its range that a task has to be worse by to count, and that suffice alone."""

# Mechanisms ------------------------------------------------------------------------------------

Replaced = tuple[str, Any]
"""`module:Class.attribute` or `module:name` of serp, and what stands there instead."""


def always(value: Any) -> property:
    """Return an attribute that keeps its value, whatever is written to it."""
    return property(lambda self: value, lambda self, written: None)


def leads(self: Any, situation: Any, learner: Any) -> Any:
    """Propose as the strategy `evidence` does where all plans differ."""
    return learner.propose_greedily() if self._leads[self.env_index] else None


def leads_greedily(self: Any, situation: Any, learner: Any) -> Any:
    """Propose as its trained policy does where all plans differ."""
    return learner.propose_greedily() if self.rho > 0.5 else None


FAR, PLANNER = "planning", "planning.far_sight:FarSightPlanner"
RESIDUAL, ADAPTED = "model.learned.residual:ResidualRegression", "model.learned.adapted_model"
EVIDENCE, NOTHING = "agent.evidence:Evidence", np.zeros(0, dtype=np.int64)
# fmt: off
WITHOUT: Final[dict[str, Sequence[str | Replaced]]] = {
    # The planner
    "far-sight": ["planner.name=lookahead"],
    "closed-graph": [(f"{PLANNER}._may_search", lambda self, state: False)],
    "goal-search": [(f"{FAR}.goal_search:GoalSearch.goal", always(False))],
    "cells": [(f"{PLANNER}._find_cells", lambda self, state, visited: None)],
    "unknown": [(f"{FAR}.cell_graph:CellGraph.explores", always(False))],
    "budget": [(f"{PLANNER}._saved", always(200_000)), (f"{PLANNER}._wait", always(0))],
    "inert": [(f"{FAR}.{module}:inert_fluents", lambda model: NOTHING)
              for module in ("closed_graph", "goal_search", "cell_graph")],
    "slack": ["planner.accepted_risk=0"],
    # What is learned of the model
    "adaptation": ["adaptation.mode=off"],
    "parameters": ["adaptation.mode=residual"],
    "residual-and-counts": ["adaptation.mode=parameters"],
    "residual": [(f"{RESIDUAL}.learn", lambda *given: False)],
    "counts": [("model.learned.outcome_counts:OutcomeCounts.used", always(False))],
    "random-features": [("model.learned.residual:_FEATURES_FROM", np.inf)],
    "change-test": [(f"{RESIDUAL}._forget", lambda self: None)],
    "leverage": [(f"{FAR}.cell_graph:UNKNOWN", np.inf),
                 (f"{ADAPTED}:AdaptedModel.uncertainty",
                  lambda self, state: np.zeros(len(self.actions)))],
    "exploration": [("agent.agent:MIN_VISITS", 0)],
    # Who decides
    "veto-ahead": ["arbiter.veto_horizon=step"],
    "ways-on": [("agent.veto:VetoPolicy.looks_farther", always(False))],
    "reliability": [("agent.veto:LookaheadReliability.reliable", always(True))],
    "r-min": ["arbiter.r_min=none"],
    "evidence": ["guide.strategy=mixture"],
    "indifference": [(f"{EVIDENCE}.propose", leads),
                     (f"{EVIDENCE}.propose_greedily", leads_greedily)],
    "imitation": [(f"{EVIDENCE}.imitates", False), (f"{EVIDENCE}.imitated", lambda *given: -1)],
    # The learner
    "ensemble": ["learner.members=1"],
    "layer-norm": ["learner.layer_norm=false"],
    "n-step": ["learner.n_step=1"],
    # Without a target network there is no clipped gradient, either.
    "target-network": ["learner.target_polyak=none"],
    "gradient-clip": [("learning.gradient_updates:_LARGEST_NORM", np.inf)],
    "epsilon": ["learner.epsilon_steps=0", "learner.epsilon_end=0"],
}
# fmt: on
"""Mechanism → how it is switched off: settings, and replacements in the code of a worker."""


def changes_of(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the settings that mechanisms are switched off by."""
    changes: dict[str, dict[str, Any]] = defaultdict(dict)
    for text in (each for name in names for each in WITHOUT[name] if isinstance(each, str)):
        place, _, value = text.partition("=")
        section, _, setting = place.partition(".")
        number = value[0].isdigit() or value in ("false", "none")
        changes[section][setting] = json.loads(value.replace("none", "null")) if number else value
    return dict(changes)


def place_of(text: str) -> tuple[Any, str]:
    """Return the object that holds what `module:name` means, and its name there."""
    module, _, path = text.partition(":")
    owner: Any = importlib.import_module(f"serp.{module}")
    *owners, name = path.split(".")
    for each in owners:
        owner = getattr(owner, each)
    assert name in inspect.getsource(owner), f"{text} is gone"
    return owner, name


def replace(names: Sequence[str]) -> None:
    """Switch mechanisms off in this process, as far as that takes more than settings."""
    for each in (each for name in names for each in WITHOUT[name] if not isinstance(each, str)):
        setattr(*place_of(each[0]), each[1])


# Training and evaluation -----------------------------------------------------------------------


class Training(NamedTuple):
    """One training; its rows have the same columns."""

    without: str
    task: str
    seed: int


class Over(Exception):
    """Ends a training in the middle of an episode."""


class Played(NamedTuple):
    """An episode: its return, its steps that came out unsafe, whether the environment ended it."""

    return_: float
    unsafe: int
    terminated: bool


def played(
    env: Any, agent: Any, first: int, episodes: int, decide: Callable[[Any, Any], int] | None = None
) -> list[Played]:
    """Return episodes of a policy, that of the agent by default, with the seeds from `first` on."""
    decide = decide or (lambda state, x: int(agent.decide_greedily(state, x).action))
    rows = []
    for seed in range(first, first + episodes):
        (raw, info), over, total, unsafe = env.reset(seed=seed), False, 0.0, 0
        agent.arbiter.begin_episode()
        while not over:
            action = decide(*agent.perceive(raw, info, env.env))
            raw, reward, terminated, truncated, info = env.step(action)
            total, over = total + reward, terminated or truncated
            unsafe += bool(info.get("unsafe"))
        rows.append(Played(total, unsafe, terminated))
    return rows


def rows_of(training: Training, points: Sequence[int]) -> list[Row]:
    """Train for the largest number of env steps, and evaluate at every point."""
    warnings.simplefilter("ignore")
    task = find_task(training.task)
    settings = resolve("default", task.settings, changes_of(mechanisms_of(training.without)))
    rows: list[Row] = []
    returns: list[float] = []
    counts = dict.fromkeys(COUNTS, 0)
    made, begun, paused = 0, 0.0, 0.0

    def evaluate(agent: Any) -> Row:
        spent, decisions, random = 0.0, 0, np.random.default_rng(0)

        def plan(state: Any, x: Any) -> int:
            nonlocal spent, decisions
            start = time.process_time()
            action = agent.guarded.plan(state).action
            spent, decisions = spent + time.process_time() - start, decisions + 1
            return int(action)

        policies: dict[str, Callable[[Any, Any], int] | None] = {
            "planner": plan,
            "serp": None,
            "learner": lambda state, x: int(agent.learner.propose_greedily(x).action),
            "random": lambda state, x: int(random.integers(bound.actions.size)),
        }
        row: Row = {**training._asdict(), "env_steps": made, "episodes": len(returns), **counts}
        row["training"] = float(np.mean(returns)) if returns else float("nan")
        for name, decide in policies.items():
            with agent.undisturbed():
                episodes = EPISODES.get(family(training.task), 10)
                shown = played(arena, agent, 1_000_000, episodes, decide)
                row[name] = float(np.mean([episode.return_ for episode in shown]))
        return row | {"ms_per_decision": 1e3 * spent / max(1, decisions)}

    def on_step(step: Any) -> None:
        nonlocal made, paused
        made += 1
        counts["unsafe"] += step.decision.unsafe
        counts["avoidable_unsafe"] += step.decision.avoidable_unsafe
        counts["unsafe_observed"] += step.unsafe_observed
        if step.last:
            returns.append(step.episode.return_)
        if made in points:
            pause = time.process_time()
            speed = made / (pause - begun - paused)
            row = evaluate(trainer.agent) | {"steps_per_cpu_second": speed}
            rows.append({k: float(f"{v:.6g}") if type(v) is float else v for k, v in row.items()})
            paused += time.process_time() - pause
        if made == max(points):
            raise Over

    with (
        task.bind() as bound,
        find_task(training.task).bind() as arena,
        Trainer(bound, settings, training.seed) as trainer,
    ):
        trainer.on_step = on_step
        begun = time.process_time()
        try:
            while True:
                next(trainer.run())
        except Over:
            return rows


def mechanisms_of(without: str) -> list[str]:
    """Return the mechanisms that the column `without` names."""
    return without.split("+") if without else []


def run(wanted: Sequence[Training], options: argparse.Namespace, rows: list[Row]) -> bool:
    """Run trainings that the rows lack, and add their rows; return whether one failed."""
    there = {(*(row[k] for k in Training._fields), row["env_steps"]) for row in rows}
    parts: dict[str, list[Training]] = defaultdict(list)
    for one in wanted:
        if any((*one, point) not in there for point in options.points):
            parts[one.without].append(one)
    failed, begun = False, time.monotonic()
    for without, part in parts.items():
        given = options.jobs, get_context("spawn"), replace, (mechanisms_of(without),)
        with ProcessPoolExecutor(*given) as pool:
            jobs = {pool.submit(rows_of, one, options.points): one for one in part}
            for job in as_completed(jobs):
                print(*jobs[job], f"{time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
                if error := job.exception():
                    failed = True
                    traceback.print_exception(error)
                    continue
                new = [row for row in job.result() if (*jobs[job], row["env_steps"]) not in there]
                rows += new
                if options.out is not None:
                    write(options.out, new)
    return failed


def write(path: Path, rows: Sequence[Row]) -> None:
    """Append rows to a CSV."""
    fresh = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerows(rows)


def read(path: Path | None) -> list[Row]:
    """Return the rows of a CSV; none where there is no file."""
    if path is None or not path.exists():
        return []
    whole = ("seed", "env_steps", "episodes", *COUNTS)
    kinds = {name: int if name in whole else float for name in COLUMNS[2:]}
    with path.open(newline="", encoding="utf-8") as file:
        return [{k: kinds.get(k, str)(v) for k, v in row.items()} for row in csv.DictReader(file)]


# Tables ----------------------------------------------------------------------------------------


class Mean(NamedTuple):
    """A mean, and half the width of its 95 % interval; infinite for one seed."""

    value: float
    half: float

    @property
    def sure(self) -> bool:
        """Whether the interval does not hold 0."""
        return abs(self.value) > self.half

    def text(self, form: str) -> str:
        """Return mean and interval."""
        noise = "" if self.half == np.inf else f" ± {float(f'{self.half:.2g}'):g}"
        return f"{self.value:{form}}{noise}".replace("-", "−")


def mean(values: Sequence[float]) -> Mean:
    """Return the mean of values of several seeds."""
    from scipy.stats import t

    count, spread = len(values), float(np.std(values, ddof=1)) if np.ptp(values) else 0.0
    half = np.inf if count < 2 else t.ppf(0.975, count - 1) * spread / count**0.5
    return Mean(float(np.mean(values)), float(half))


def family(task: str) -> str:
    """Return the task that a task is a variant of, itself for others."""
    base = task.partition("-")[0]
    return base if base in task_entries() else task


def grouped(rows: Sequence[Row]) -> dict[tuple[str, int], dict[int, Row]]:
    """Return rows by task and point, and by seed."""
    groups: dict[tuple[str, int], dict[int, Row]] = defaultdict(dict)
    for row in sorted(rows, key=lambda row: (row["task"], row["env_steps"], row["seed"])):
        groups[row["task"], row["env_steps"]][row["seed"]] = row
    return groups


def summary(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Yield the table of means over the seeds, its head first."""
    yield ["task", "env steps", "seeds", *COMPARED, "unsafe", "avoidable", "steps/s", "ms"]
    for (task, point), group in grouped(rows).items():
        column = {name: [row[name] for row in group.values()] for name in COLUMNS[2:]}
        cells = [task, f"{point:,}", f"{len(group)}"]
        cells += [mean(column[name]).text(".4g") for name in COMPARED]
        cells += [f"{np.mean(column['unsafe_observed']):.2g}", f"{sum(column['avoidable_unsafe'])}"]
        cells.append(f"{np.median(column['steps_per_cpu_second']):.0f}")
        yield [*cells, f"{np.median(column['ms_per_decision']):.2g}"]


class Compared(NamedTuple):
    """Differences in per cent of the range by column, ratios of speed and time, and seeds."""

    differences: dict[str, Mean]
    speed: float
    time: float
    seeds: int


def compare(rows: Sequence[Row], others: Sequence[Row]) -> dict[tuple[str, int], Compared]:
    """Return how rows differ from others, by task and point."""
    low, best = defaultdict(list), defaultdict(list)
    for (task, _), group in grouped(others).items():
        low[family(task)] += [row["random"] for row in group.values()]
        best[family(task)] += [np.mean([row[k] for row in group.values()]) for k in POLICIES]
    found = {}
    for place, group in grouped(rows).items():
        beside = grouped(others).get(place, {})
        pairs = [(row, beside[seed]) for seed, row in group.items() if seed in beside]
        if not pairs:
            continue
        base = family(place[0])
        unit = 100.0 / (float(max(best[base]) - np.mean(low[base])) or 1.0)
        differences = {k: mean([unit * (a[k] - b[k]) for a, b in pairs]) for k in COMPARED}
        ratios = (
            float(np.exp(np.mean([np.log(a[k] / b[k]) for a, b in pairs])))
            for k in ("steps_per_cpu_second", "ms_per_decision")
        )
        found[place] = Compared(differences, *ratios, len(pairs))
    return found


def changed(found: dict[tuple[str, int], Compared]) -> Iterator[list[str]]:
    """Yield the table of differences, its head first."""
    yield ["task", "env steps", "seeds", *COMPARED, "speed ×", "ms ×"]
    for (task, point), row in found.items():
        shown = [each.text("+.1f") + "*" * each.sure for each in row.differences.values()]
        yield [task, f"{point:,}", f"{row.seeds}", *shown, f"{row.speed:.2f}", f"{row.time:.2f}"]


def verdict(
    found: dict[tuple[str, int], Compared], columns: Sequence[str]
) -> tuple[list[str], list[str], str, str]:
    """Return where it is worse and better without a mechanism, what loss is not excluded, and
    whether the mechanism should stay: *unclear* where a large loss hides in the noise.
    """
    shown: dict[float, list[str]] = {-1.0: [], 1.0: []}
    families, least, where = set(), 0.0, ""
    for (task, _), row in found.items():
        tried = {k: v for k, v in row.differences.items() if k in columns}
        low = min(v.value - v.half for v in tried.values())
        least, where = (low, f" ({task})") if low < least else (least, where)
        for sign, places in shown.items():
            sure = {k: v for k, v in tried.items() if v.sure and sign * v.value > NOTICED}
            if sure:
                name = max(sure, key=lambda k: abs(sure[k].value))
                places.append(f"{task} {sure[name].text('+.0f')} ({name})")
                if sign < 0.0:
                    families.add(family(task))
                    if sure[name].value < -LARGE:
                        families.add("so large that it suffices")
    said = "stays" if len(families) > 1 else "unclear" if least < -LARGE else "goes"
    return shown[-1.0], shown[1.0], f"{least:.0f}{where}".replace("-", "−", 1), said


def worths(rows: Sequence[Row], others: Sequence[Row]) -> Iterator[list[str]]:
    """Yield the table of mechanisms, its head first."""
    yield ["without", "worse", "better", "not excluded", "speed ×", "verdict"]
    names = {row["without"] for row in rows}
    for name in (name for name in WITHOUT if name in names):
        found = compare([row for row in rows if row["without"] == name], others)
        learns = any("learner." in str(each) for each in WITHOUT[name]) or name == "imitation"
        columns = COMPARED if learns else ("planner", "serp", "training")
        worse, better, least, said = verdict(found, columns)
        speed = float(np.exp(np.mean([np.log(row.speed) for row in found.values()])))
        cells = [name, "; ".join(worse) or "–", "; ".join(better) or "–"]
        yield [*cells, least, f"{speed:.2f}", said]


def named() -> list[str]:
    """Return the names of all tasks and of their variants."""
    own = sorted(task_entries())
    files = sorted(path.stem for path in (ROOT / "domains").glob("*-*.pddl"))
    variants = [name for name in files if name not in own and not name.endswith("-problem")]
    return own + variants


def main() -> int:
    """Run what is not in the file, and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tasks", nargs="*")
    parser.add_argument("--points", help="numbers of env steps")
    parser.add_argument("--seeds", default="0-4", help="first-last")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--without", action="append", default=[], choices=sorted(WITHOUT))
    parser.add_argument("--mechanisms", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--print", action="store_true", dest="prints")
    options = parser.parse_args()
    points = options.points or ("2000" if options.mechanisms else "500,2000,5000")
    options.points = sorted({int(point) for point in points.split(",")})
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    each = options.without or list(WITHOUT)
    sets = each if options.mechanisms else ["+".join(options.without)]
    tasks = options.tasks or named()
    rows = read(options.out)
    # Numerical libraries in the workers use one thread: with more, small networks are slower.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
    wanted = [Training(name, task, seed) for name in sets for seed in seeds for task in tasks]
    failed = False if options.prints else run(wanted, options, rows)
    rows = [row for row in rows if row["without"] in sets and row["task"] in tasks]
    rows = [row for row in rows if row["env_steps"] in options.points]
    if options.mechanisms:
        table = worths(rows, read(options.against or ROOT / "docs" / "results" / "ladder.csv"))
    else:
        others = read(options.against)
        table = changed(compare(rows, others)) if others else summary(rows)
    for k, cells in enumerate(table):
        print(f"|{'|'.join(cells)}|" + f"\n|{'---|' * len(cells)}" * (k == 0))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
