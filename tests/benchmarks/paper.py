"""The experiments of the paper: Figures 2a, 2b and 3, with presets `paper` and `default`.

    python -m tests.benchmarks.paper [--seeds 10] [--out runs/paper] [--collect]

Each panel of Figure 2 is a comparison of `serp compare` in a folder of `--out`; trials that were
stopped go on. At its end, or at any time with `--collect`, it writes all complete trials to
paper.csv, draws the figures, and renews the tables of docs/results/paper.md.
"""

import argparse
import csv
import re
from collections import Counter
from itertools import groupby
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from docs.drawings.soccer_actions import MOVES, beside, frame, panel
from serp._util.figures import PALETTE, STYLE, legend, render
from serp.runs.comparison.compare import compare, read_plan
from serp.runs.comparison.report import estimate_text
from serp.runs.comparison.statistics import Curves, Results, estimate, training_curves
from serp.runs.comparison.trial import Record, Trial, file_name, read_evaluations
from serp.runs.evaluation import play
from serp.runs.run import load_run

RESULTS = Path(__file__).parents[2] / "docs" / "results"
MRP = "mrp:planner.name=lookahead;planner.discount=0.9;adaptation.mode=off"
PANELS = {
    "cartpole-paper": (40_000, ("serp-paper", "dqn-paper", MRP)),
    "cartpole-default": (10_000, ("serp", "dqn", "ppo")),
    "soccer-paper": (24_000, ("serp-paper", "dqn-paper", MRP)),
    "soccer-default": (12_000, ("serp", "dqn")),
}
"""Folder, TASK-PRESET → env steps, algorithms. MrP and PPO are drawn in both panels of a task."""
SHOWN = {
    **dict.fromkeys(("serp-paper", "serp"), ("SErP", PALETTE["vermilion"][0], "-")),
    **dict.fromkeys(("dqn-paper", "dqn"), ("DQN", PALETTE["blue"][0], "-")),
    "ppo": ("PPO", PALETTE["green"][0], "-"),
    MRP: ("MrP", PALETTE["purple"][0], "--"),
}
"""Algorithm → its name in the paper, colour, dashes."""
MEASURES = ("first_50", "last_fifth", "final_policy", "unsafe", "avoidable_unsafe")
ACTIONS = ("cover-goal", "side-advance left", "side-advance right", "frontal-contrast")
PARTS = [f"to {4 * part} %" for part in range(1, 26)]
"""Columns of a training curve: the moving mean of 20 episodes, averaged over parts of the steps."""
COLUMNS = ("panel", *Trial._fields, "episodes", *MEASURES, *ACTIONS, *PARTS)


def collect(out):
    """Return a row for each complete trial, panel by panel."""
    rows = []
    for name, (env_steps, algorithms) in PANELS.items():
        plan = read_plan(out / name)
        for trial in (Trial(a, seed) for a in algorithms for seed in (plan.seeds if plan else ())):
            folder = out / name / "trials" / f"{file_name(trial.algorithm)}-{trial.seed}"
            if env_steps not in (evaluations := read_evaluations(folder)).get("env_steps", ()):
                continue
            metrics = load_run(folder).metrics
            within = metrics["env_steps"] <= env_steps
            episodes = {key: column[within] for key, column in metrics.items()}
            record = Record(trial, episodes, evaluations, {})
            measured = Results([record], plan).measured[trial]
            curve = training_curves([record], env_steps).y.reshape(len(PARTS), -1).mean(axis=1)
            if name.startswith("soccer"):
                measured |= chosen(folder, env_steps)
            measured |= {"last_fifth": curve[-5:].mean(), **dict(zip(PARTS, curve, strict=True))}
            numbers = {key: f"{measured[key]:.5g}" for key in COLUMNS[4:] if key in measured}
            rows.append({"panel": name, **trial._asdict(), "episodes": within.sum(), **numbers})
    return rows


def chosen(folder, env_steps):
    """Return how often soccer's moves were chosen in the last 5,000 steps, not explored."""
    counts = Counter()
    with (folder / "decisions.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            late = env_steps - 5_000 <= int(row["step"]) < env_steps
            counts[row["executed"]] += late and row["executed_by"] != "exploration"
    return {action: counts[action] / counts.total() for action in ACTIONS}


def trials_of(rows, task, algorithms=tuple(SHOWN)):
    """Yield each of the algorithms that has complete trials of a task, and its rows."""
    for algorithm in dict.fromkeys(algorithms):
        own = [row for row in rows if row["algorithm"] == algorithm]
        if trials := [row for row in own if row["panel"].startswith(task)]:
            yield algorithm, trials


def draw(rows, task):
    """Return Figure 2a or 2b: interquartile means with 95 % intervals over the seeds."""
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(9.5, 4.0), layout="constrained")
        both = figure.subplots(1, 2, sharey=True)
        for axes, preset in zip(both, ("paper", "default"), strict=True):
            budget, algorithms = PANELS[f"{task}-{preset}"]
            for algorithm, trials in trials_of(rows, task, (*algorithms, "ppo", MRP)):
                x = (np.arange(len(PARTS)) + 0.5) * PANELS[trials[0]["panel"]][0] / len(PARTS)
                y = np.array([[float(row[part]) for part in PARTS] for row in trials])
                centre, low, high = Curves(x, y).band()
                label, colour, dashes = SHOWN[algorithm]
                axes.plot(x, centre, dashes, color=colour, label=label, linewidth=2.2)
                axes.fill_between(x, low, high, color=colour, alpha=0.16, linewidth=0)
            axes.set(xlabel="env steps", title=f"{task}, preset {preset}", xlim=(0, budget))
        both[0].set_ylabel("training return (mean of 20 episodes)")
        legend(both[1])
    return figure


def tables(rows):
    """Return mark → the lines of a table of the page, each with its end."""
    found = {"cartpole": [], "soccer": [], "moves": []}
    for task in ("cartpole", "soccer"):
        for algorithm, trials in trials_of(rows, task):
            label = f"`{algorithm.partition(':')[0]}`"
            keys = ("episodes", *MEASURES, *(ACTIONS if task == "soccer" else ()))
            shown = {key: estimate([float(row[key]) for row in trials]) for key in keys}
            means = (estimate_text(shown[key]) for key in MEASURES[:2])
            counts = (f"{shown[key].value:,.0f}" for key in ("episodes", "avoidable_unsafe"))
            found[task].append([label, str(len(trials)), *counts, *means])
            if task == "soccer" and SHOWN[algorithm][0] == "SErP":
                found["moves"].append([label, *(f"{100 * shown[a].value:.0f} %" for a in ACTIONS)])
    return {k: "".join(f"|{'|'.join(cells)}|\n" for cells in v) for k, v in found.items()}


def renewed(page, rows):
    """Return the page with new lines of its tables, each below its mark and its titles."""
    for mark, lines in tables(rows).items():
        page = re.sub(rf"(<!-- {mark} -->\n.*\n.*\n)(\|.*\n)*", rf"\g<1>{lines}", page)
    return page


def moves(folder, contests=60, longest=9):
    """Return Figure 3: the longest time for which a trained defender keeps to each move."""
    run, best = load_run(folder), {}
    with run.environment("rgb_array") as task:
        for steps in play(run.agent, task, episodes=contests, seed=1):
            for action, held in groupby(steps, key=lambda step: step.decision.action):
                seen = [frame(task.env, step.info) for step in held][:longest]
                best[action] = max(best.get(action, []), seen, key=len)
    return beside([panel(name, best[action]) for name, action in MOVES])


def main():
    """Train what is missing, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--collect", action="store_true", help="train nothing")
    parser.add_argument("--out", type=Path, default=Path("runs/paper"))
    options = parser.parse_args()
    for name, (env_steps, algorithms) in () if options.collect else PANELS.items():
        task = name.partition("-")[0]
        compare(
            task, algorithms=algorithms, seeds=options.seeds, env_steps=env_steps, jobs=1,
            evaluate_every=env_steps, final_episodes=10 if task == "cartpole" else 50,
            out=options.out / name,
        )  # fmt: skip
    rows = collect(options.out)
    with (RESULTS / "paper.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    images = RESULTS.parent / "images"
    for task in ("cartpole", "soccer"):
        (images / f"paper-{task}.svg").write_bytes(render(draw(rows, task), "svg"))
    page = RESULTS / "paper.md"
    page.write_text(renewed(page.read_text("utf-8"), rows), "utf-8")
    if (trained := options.out / "soccer-default" / "trials" / "serp-0" / "summary.json").is_file():
        moves(trained.parent).save(images / "paper-moves.png", optimize=True)


if __name__ == "__main__":
    main()
