"""Print the numbers of a finished comparison that speak for and against the paper's claims.

    serp compare --domain cartpole --algorithms serp,serp-paper,mrp,dqn,ppo --out FOLDER
    python tests/benchmarks/study_paper_claims.py FOLDER

The claims are those of section 4 and Figure 2. Each number is a difference between the means of two
algorithms over the seeds of the base domain file, with its 95 % bootstrap interval. It speaks for
the claim where the interval lies wholly on the claim's side, against it where it lies wholly on the
other side, and is open otherwise. A time that was never reached counts as the whole budget.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from serp.comparison.analysis.statistics import Estimate, difference, mean, standard_deviation
from serp.comparison.report.formatting import estimate_text

MARGIN = 0.05  # of the range of returns: what counts as similar, and as not below


class Study:
    """The claims, looked at for one algorithm in the exported files of a comparison."""

    def __init__(self, folder: Path, subject: str) -> None:
        self.about = json.loads((folder / "comparison.json").read_text())
        with open(folder / "measures.csv", newline="") as file:
            self.measures = [row for row in csv.DictReader(file) if self.is_base(row)]
        with open(folder / "episodes.csv", newline="") as file:
            self.episodes = [row for row in csv.DictReader(file) if self.is_base(row)]
        self.algorithms = {row["algorithm"] for row in self.measures}
        paper = subject == "serp-paper" and "dqn-paper" in self.algorithms
        self.subject, self.dqn = subject, "dqn-paper" if paper else "dqn"

    def is_base(self, row: dict[str, str]) -> bool:
        return row["variant"] == self.about["base"]

    def values(self, algorithm: str, name: str) -> np.ndarray:
        """Return a measure of the seeds that have it."""
        cells = [row[name] for row in self.measures if row["algorithm"] == algorithm]
        found = np.array([float(cell) for cell in cells if cell])
        return np.where(np.isposinf(found), self.about["env_steps"], found)

    def compare(self, name: str, first: str, second: str, low=0.0, high=np.inf, of=mean) -> str:
        """Return a line on first − second, which the claim has between two limits."""
        found = difference(self.values(first, name), self.values(second, name), of)
        title = self.about["measures"][name]["title"]
        return line(f"{title}, {first} − {second}", found, low, high)

    def better(self, others: tuple[str, ...], *names: str) -> Iterator[str]:
        """Yield lines on measures in which the subject is to be better than others."""
        for other in others:
            for name in names if other in self.algorithms else ():
                lower = self.about["measures"][name]["better"] == "lower"
                pair = (other, self.subject) if lower else (self.subject, other)
                yield self.compare(name, *pair)

    def blocks(self, algorithm: str, edges: np.ndarray) -> np.ndarray:
        """Return the time average of the running episode's return, `[blocks, seeds]`."""
        rows = []
        for seed in map(str, self.about["seeds"]):
            played = [
                (float(row["env_steps"]), float(row["return"]))
                for row in self.episodes
                if (row["algorithm"], row["seed"]) == (algorithm, seed)
            ]
            if played:
                ends, returns = np.array([(0.0, 0.0), *played]).T
                ends[-1] = max(ends[-1], edges[-1])  # the last episode's return goes on
                sums = np.cumsum(np.diff(ends, prepend=0.0) * returns)
                rows.append(np.diff(np.interp(edges, ends, sums)) / np.diff(edges))
        return np.array(rows).reshape(-1, len(edges) - 1).T

    def never_below(self) -> str:
        """Return a line on the blocks of training in which the subject is below the planner."""
        budget = self.about["env_steps"]
        width = max(self.about["evaluate_every"], -(-budget // 60))
        edges = np.append(np.arange(0.0, budget, width), budget)
        ours, planners = self.blocks(self.subject, edges), self.blocks("mrp", edges)
        found = [difference(a, b, mean) for a, b in zip(ours, planners, strict=True)]
        lowest = min(found, key=lambda one: np.inf if one.high is None else one.high)
        what = f"lowest of {len(found)} blocks of {width:,} env steps, {self.subject} − mrp"
        # A block counts against the claim only where its whole interval is below 0.
        says = "not measured" if lowest.high is None else "against" if lowest.high < 0 else "for"
        return f"  {says:<13} {what}: {estimate_text(lowest, signed=True)}"

    def claims(self) -> dict[str, list[str]]:
        """Return the lines on each claim."""
        ours, dqn, margin = self.subject, self.dqn, MARGIN * self.about["range"]
        early = ("first_10", "first_50")
        time = ("threshold_env_steps", "learner_threshold_env_steps")
        executed = {name: self.values(name, "unsafe").sum() for name in self.algorithms}
        avoidable = self.values(ours, "avoidable_unsafe").sum()
        says = ("against" if avoidable else "for") if any(executed.values()) else "not measured"
        return {
            "Good with fewer samples than DQN and PPO (4.1, 4.2, Figure 2a)": [
                *self.better((dqn, "ppo", "sb3-dqn"), "training_area", *time)
            ],
            "Never below the planner, in the first iterations either (4.1)": [
                *(self.compare(name, ours, "mrp", -margin) for name in early),
                self.never_below(),
            ],
            "DQN's spread over the seeds is larger: standard deviations (4.1, Figure 2a)": [
                self.compare(name, dqn, ours, of=standard_deviation)
                for name in ("training_area", "final_learner")
            ],
            "Ahead of MrP and DQN from the first iterations on (4.2, Figure 2b)": [
                *self.better(("mrp", dqn), *early, "training_area")
            ],
            f"DQN ends on similar values: within ±{margin:.4g} (4.2, Figure 2b)": [
                self.compare(name, ours, dqn, -margin, margin)
                for name in ("last_20", "final_learner")
            ],
            "Critical actions are avoided (4.2)": [
                f"  {says:<13} unsafe actions executed by {ours}: {executed[ours]:,.0f}, "
                f"{avoidable:,.0f} of them avoidable",
                *self.better((dqn,), "unsafe"),
            ],
        }


def line(what: str, found: Estimate, low: float, high: float) -> str:
    """Return a number and what it says of a claim that has it between two limits."""
    says = "open"
    if found.low is None or found.high is None:
        says = "not measured"
    elif low < found.low and found.high < high:
        says = "for"
    elif found.high < low or found.low > high:
        says = "against"
    return f"  {says:<13} {what}: {estimate_text(found, signed=True)}"


def main() -> None:
    """Print the claims."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="of a finished comparison")
    folder = parser.parse_args().folder
    for subject in ("serp", "serp-paper"):
        study = Study(folder, subject)
        for claim, lines in study.claims().items() if subject in study.algorithms else ():
            print(f"{subject}: {claim}", *lines, "", sep="\n")


if __name__ == "__main__":
    main()
