"""The field's table: serp, what it stands beside, and learners that no file helps.

    python -m tests.benchmarks.field --seeds 10 [TASK ...] [--engine ray]
    python -m tests.benchmarks.field --print

Trials are those of `serp.compare`, seed by seed: 2,000 env steps of every algorithm, and 20,000 of
those without a planner on tasks that cost little. What is complete is not run again. After each
comparison docs/results/field.csv is written anew, one row a trial. Its columns:

`return`, `area`: final policy; time average of the return of the running training episode.
`score`, `area_score`: the same on a scale from random actions (0) to the best known (1), which is
the exact solution or the best mean of a policy in ladder.csv.
`decisions`: env steps until 90 % of the best known are reached, by an evaluation of the learner or
by a mean of training episodes: the last 10, or those of the last 500 steps where they are fewer.
Empty: not reached.
`unsafe`, `avoidable`: training steps that came out unsafe; executed flagged actions while another
was not flagged. `updated`: whether a learner ever updated. Where the budget ends before its first
update, the row has no numbers.

`exact` is finite-horizon value iteration in Gymnasium's own tables, within the time limit.
`--print` prints interquartile means over tasks and seeds, with 95 % intervals of a bootstrap that
is stratified by task (Agarwal et al. 2021), and draws performance profiles; field-summary.csv has
the same table.
"""

import argparse
import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import bootstrap

import serp
from serp._util import figures
from serp.errors import Interrupted, RunError
from serp.runs.comparison.algorithms import find_algorithm
from serp.runs.comparison.statistics import evaluation_curve, interquartile_mean, measure
from serp.runs.comparison.trial import Record, make_external
from serp.tasks.registry import find_task
from tests.benchmarks import ladder

RESULTS = Path(__file__).parents[2] / "docs" / "results"
PICTURE = RESULTS.parent / "images" / "field-profiles.svg"
CHEAP = ("cartpole", "frozen-lake", "cliff", "taxi")
TASKS = (*CHEAP, "door-key", "hill", "corner-kick", "swing-up", "lunar-lander", "tidy")
GUIDED = ("serp", "darling", "loki", "ac-teach", "residual", "r-max", "tmp-rl", "jsrl", "dqfd")
ALONE = ("dqn", "sb3-dqn", "ppo", "maskable-ppo")
ALGORITHMS = ("serp", "mrp", *GUIDED[1:], *ALONE)
SHORT, LONG = 2_000, 20_000
FINAL = {"frozen-lake": 50, "corner-kick": 40, "cliff": 30, "taxi": 30, "hill": 20}
COLUMNS = (
    "task", "algorithm", "seed", "env_steps", "return", "score", "area", "area_score", "decisions",
    "unsafe", "avoidable", "updated",
)  # fmt: skip
Row = dict[str, Any]

# Running ---------------------------------------------------------------------------------------


def rounds(seeds: int) -> Iterator[tuple[int, tuple[str, ...], tuple[int, ...]]]:
    """Yield budgets, tasks and seeds, so that what is complete is useful at any moment."""
    blocks = [block for block in ((0,), (1,), (2,), (3, 4), (5, 6, 7, 8, 9)) if block[0] < seeds]
    for k, block in enumerate([*blocks, *((seed,) for seed in range(10, seeds))]):
        yield SHORT, TASKS, tuple(seed for seed in block if seed < seeds)
        if 1 <= k <= 3:
            yield LONG, CHEAP, (k - 1,)


def learning(task: str, names: tuple[str, ...], env_steps: int) -> list[str]:
    """Return the algorithms that update within a budget."""
    with find_task(task).bind() as bound:
        found = []
        for each in map(find_algorithm, names):
            first = 0
            if each.make_external is not None:
                made = make_external(each, bound, each.settings(bound.task, {}), 0)
                first = getattr(made[2], "first_update", 0)
            if first <= env_steps:
                found.append(each.name)
    return found


def run(options: argparse.Namespace, rows: dict[tuple[Any, ...], Row]) -> None:
    """Run what is missing, and keep the rows."""
    figures.render = lambda figure, kind: b"<svg/>"  # pictures would take a third of the time
    for env_steps, tasks, seeds in rounds(options.seeds):
        names = ALGORITHMS if env_steps == SHORT else ALONE
        for task in (each for each in tasks if each in (options.tasks or TASKS)):
            known = {key[1:3] for key in rows if (key[0], key[3]) == (task, env_steps)}
            if all({(name, str(seed)), (name, "")} & known for name in names for seed in seeds):
                continue
            scale, shown = Scale(task), learning(task, names, env_steps)
            given = {
                "seeds": seeds, "env_steps": env_steps, "evaluate_every": max(500, env_steps // 10),
                "evaluation_episodes": 5, "final_episodes": FINAL.get(task, 10),
                "out": options.out / f"{task}-{env_steps}", "engine": options.engine,
                "address": options.address, "quiet": True,
                "jobs": options.jobs or (1 if options.engine == "local" else None),
            }  # fmt: skip
            try:
                found = serp.compare(task, algorithms=shown, **given).results
            except RunError as error:
                print(error, file=sys.stderr, flush=True)
                continue
            made = [scale.row(record, env_steps) for record in found.records]
            late = {"task": task, "seed": "", "env_steps": env_steps, "updated": 0}
            made += [{**late, "algorithm": each} for each in names if each not in shown]
            if (best := exact(task)) is not None:
                solved = {"algorithm": "exact", "env_steps": 0, "updated": ""}
                made.append({**late, **solved, "return": best, "score": scale.score(best)})
            for row in made:
                rows[task, row["algorithm"], str(row["seed"]), row["env_steps"]] = row
            write([*rows.values()])
            print(task, env_steps, *seeds, file=sys.stderr, flush=True)


class Scale:
    """The scale of a task: from random actions to the best known."""

    def __init__(self, task: str) -> None:
        self.task = task
        there = [row for row in ladder.read(RESULTS / "ladder.csv") if row["task"] == task]
        points = {row["env_steps"] for row in there if not row["without"]}
        means = [
            np.mean([row[policy] for row in there if row["env_steps"] == point])
            for point in points
            for policy in ladder.POLICIES
        ]
        self.random = float(np.mean([row["random"] for row in there]))
        solved = exact(task)
        self.best = float(max(means)) if solved is None else solved

    def score(self, value: float) -> float:
        """Return a return on the scale."""
        return (value - self.random) / (self.best - self.random)

    def row(self, record: Record, env_steps: int) -> Row:
        """Return the row of a trial."""
        measured = measure(record, env_steps, None)
        final, area = measured["final_policy"], measured["training_area"]
        return {
            "task": self.task, "algorithm": record.trial.algorithm, "seed": record.trial.seed,
            "env_steps": env_steps, "return": final, "score": self.score(final), "area": area,
            "area_score": self.score(area), "decisions": self.decisions(record),
            "unsafe": measured["unsafe_observed"], "avoidable": measured["avoidable_unsafe"],
            "updated": int(record.trial.algorithm != "mrp"),
        }  # fmt: skip

    def decisions(self, record: Record) -> float | str:
        """Return the env steps to 90 % of the best; empty if they are not reached."""
        good = self.random + 0.9 * (self.best - self.random)
        at, worth = evaluation_curve(record)
        reached = [*at[worth >= good]]
        returns, ends = record.episodes["return"], record.episodes["env_steps"]
        for k, end in enumerate(ends):
            first = max(k - 9, min(k, int(np.searchsorted(ends, end - 500, side="right"))))
            whole = k >= 9 or end >= 500
            if whole and returns[first : k + 1].mean() >= good:
                reached.append(end)
                break
        return int(min(reached)) if reached else ""


def exact(task: str) -> float | None:
    """Return the largest expected return within the time limit; None without known dynamics."""
    with find_task(task).bind() as bound:
        env, limit = bound.env.unwrapped, bound.env.spec.max_episode_steps
        if not hasattr(env, "P"):
            return None
        values = np.zeros(len(env.P))
        for _ in range(limit):
            # At the cliff, Gymnasium goes on after a fall, and the task ends.
            values = np.array([
                max(sum(p * (r + (not over and r > -100) * values[to]) for p, to, r, over in way)
                    for way in env.P[state].values())
                for state in range(len(values))
            ])  # fmt: skip
        return float(env.initial_state_distrib @ values)


# Tables ----------------------------------------------------------------------------------------


def write(rows: list[Row]) -> None:
    """Write the CSV."""
    order = {name: k for k, name in enumerate((*TASKS, "exact", *ALGORITHMS))}

    def place(row: Row) -> tuple[int, ...]:
        names = order[row["task"]], order[row["algorithm"]]
        return names[0], int(row["env_steps"]), names[1], int(row["seed"] or 0)

    with (RESULTS / "field.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in sorted(rows, key=place):
            writer.writerow({k: f"{v:.5g}" if type(v) is float else v for k, v in row.items()})


def read() -> list[Row]:
    """Return the rows of the CSV."""
    file = RESULTS / "field.csv"
    return list(csv.DictReader(file.open(encoding="utf-8"))) if file.exists() else []


def samples(rows: list[Row], algorithm: str, column: str, env_steps: int) -> list[Any]:
    """Return the numbers of an algorithm for each task that it has, by seed."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["algorithm"] == algorithm and int(row["env_steps"]) == env_steps and row[column]:
            found.setdefault(row["task"], []).append(float(row[column]))
    return [np.array(each) for each in found.values()]


def interval(parts: list[Any]) -> str:
    """Return the interquartile mean over tasks and seeds, and its stratified interval."""

    def statistic(*drawn: Any, axis: int) -> Any:
        return interquartile_mean(np.concatenate(drawn, axis=-1))

    value = f"{float(interquartile_mean(np.concatenate(parts))):.2f}"
    if min(map(len, parts)) < 2:
        return value
    ends = bootstrap(
        parts, statistic, n_resamples=2_000, vectorized=True, method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return f"{value} [{ends.low:.2f}, {ends.high:.2f}]"


def table(rows: list[Row], env_steps: int) -> Iterator[list[str]]:
    """Yield the table of a budget: algorithms that have all of its tasks."""
    yield ["algorithm", "final", "training", "reached 90 %", "decisions", "unsafe", "avoidable"]
    tasks = {row["task"] for row in rows if int(row["env_steps"]) == env_steps}
    for name in ALGORITHMS:
        final = samples(rows, name, "score", env_steps)
        if not tasks or len(final) < len(tasks):
            continue
        own = [row for row in rows if row["algorithm"] == name and row["return"]]
        trials = [row for row in own if int(row["env_steps"]) == env_steps]
        reached = [float(r["decisions"] or "inf") for r in trials]
        median = float(np.median(reached))
        counts = [sum(float(r[k]) for r in trials) / len(trials) for k in ("unsafe", "avoidable")]
        yield [
            name, interval(final), interval(samples(rows, name, "area_score", env_steps)),
            f"{np.isfinite(reached).mean():.0%}", f"{median:,.0f}" if median < np.inf else "–",
            *(f"{count:.1f}" for count in counts),
        ]  # fmt: skip


def profiles(rows: list[Row]) -> None:
    """Draw the share of trials whose score exceeds each score."""
    import matplotlib.style
    from matplotlib.figure import Figure

    colours = {"serp": "#d1495b", "mrp": "#00798c", "dqn": "#edae49", "sb3-dqn": "#7d5ba6"}
    at = np.linspace(-0.1, 1.05, 231)
    with matplotlib.style.context(["default", figures.STYLE]):
        figure = Figure(figsize=(8.0, 4.4), layout="constrained")
        axes = figure.subplots()
        names = [cells[0] for cells in table(rows, SHORT)][1:]
        for name in sorted(names, key=lambda each: each in colours):
            parts = samples(rows, name, "score", SHORT)
            share = np.mean([(part[:, None] > at).mean(axis=0) for part in parts], axis=0)
            own = name in colours
            label = name if own else "guides" if name == names[2] else None
            line = {"linewidth": 2.4} if own else {"linewidth": 1.0, "alpha": 0.6}
            axes.plot(at, share, color=colours.get(name, figures.FAINT), label=label, **line)
        axes.set(xlabel="score of the final policy", ylabel="share of trials above it", ylim=(0, 1))
        axes.set_title(f"{SHORT:,} env steps, {len(parts)} tasks", color=figures.INK, pad=24)
        figures.caption(axes, "0: random actions · 1: the best known · higher is better")
        axes.legend(loc="lower left")
    PICTURE.write_bytes(figures.render(figure, "svg"))


def main() -> int:
    """Run, or print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tasks", nargs="*")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--engine", default="local")
    parser.add_argument("--address")
    parser.add_argument("--jobs", type=int, help="trials at the same time; here 1")
    parser.add_argument("--out", type=Path, default=Path("runs/field"))
    parser.add_argument("--print", action="store_true", dest="prints")
    options = parser.parse_args()
    if not options.prints:
        there = {
            (row["task"], row["algorithm"], row["seed"], int(row["env_steps"])): row
            for row in read()
        }
        try:
            run(options, there)
        except Interrupted as stop:
            print(stop, file=sys.stderr)
            return 1
        return 0
    found = [[f"{n:,}", *cells] for n in (SHORT, LONG) for cells in [*table(read(), n)][1:]]
    found = [
        [cell.replace("-", "−") if k > 1 else cell for k, cell in enumerate(row)] for row in found
    ]
    found.insert(0, ["env steps", *next(table(read(), SHORT))])
    for k, cells in enumerate(found):
        print(f"|{'|'.join(cells)}|" + f"\n|{'---|' * len(cells)}" * (k == 0))
    for n in (SHORT, LONG):
        there = [row for row in read() if row["seed"] and int(row["env_steps"]) == n]
        seeds = {task: len({r["seed"] for r in there if r["task"] == task}) for task in TASKS}
        print(f"Seeds, {n:,} env steps:", *(f"{task} {k}" for task, k in seeds.items() if k))
    with (RESULTS / "field-summary.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(found)
    profiles(read())
    return 0


if __name__ == "__main__":
    sys.exit(main())
