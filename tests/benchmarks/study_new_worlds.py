"""Puzzles that are new in every episode: how many are solved in a training with default settings.

    python -m tests.benchmarks.study_new_worlds [WORLD ...] [--episodes 30] [--seeds 2]

`push`: two boxes in a room of 6 × 6 cells have to be pushed onto two places. `delivery`: a van has
to bring six items to a corner. Boxes, items, player and van begin in other places in every episode.
Printed are the share of the episodes from the tenth on that reach the goal, and env steps per
second of processor time.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.wrappers import TimeLimit

from serp.model.domain import Domain, load_domain
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.file_world import FileWorld
from serp.tasks.task import Task

FILES = Path(__file__).parents[1] / "serp" / "planning" / "files"
THINGS = {"push": ("bx", "by", "b", 2, 1, 5), "delivery": ("ix", "iy", "i", 6, 0, 5)}
"""World → functions and objects of what lies about, their number, first coordinate, and its end."""


class NewWorld(FileWorld):
    """A world with another initial state in every episode."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Return another initial state: no two things, nor the player, are in one place."""
        super().reset(seed=seed)
        across, down, letter, count, low, end = THINGS[self.model.ground.syntax.name]
        width = end - low
        places = self.np_random.choice(width * width, count + 1, replace=False).tolist()
        values = dict.fromkeys((fluent.name for fluent in self.model.fluents), 0.0)
        for k, place in enumerate(places):
            names = ("x", "y") if k == count else (f"{across} {letter}{k}", f"{down} {letter}{k}")
            values |= dict(zip(names, (low + place % width, low + place // width), strict=True))
        self.state = self.model.state(values)
        return self.state.copy(), {}


def problem(world: str) -> str:
    """Return the problem of a world; where things lie in it does not matter."""
    across, down, letter, count, _, _ = THINGS[world]
    things = [f"{letter}{k}" for k in range(count)]
    goal = [f"(delivered {thing})" for thing in things]
    if world == "push":
        goal = [f"(= (bx b{k}) {2 + k}) (= (by b{k}) 2)" for k in range(count)]
    start = "".join(f"(= ({across} {t}) {k}) (= ({down} {t}) 1)" for k, t in enumerate(things))
    return (
        f"(define (problem {world}-1) (:domain {world})\n"
        f"(:objects {' '.join(things)} - {'box' if world == 'push' else 'item'})\n"
        f"(:init (= (x) 0) (= (y) 0) {start})\n(:goal (and {' '.join(goal)})))\n"
    )


def made(domain: Domain) -> TimeLimit[Any, Any, Any, Any]:
    """Return the environment."""
    return TimeLimit(NewWorld(domain), 200)


def main() -> None:
    """Train and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    for name, seed in product(options.worlds or THINGS, range(options.seeds)):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "problem.pddl"
            file.write_text(problem(name), encoding="utf-8")
            domain = load_domain(FILES / f"{name}.pddl", file)
        task = Task(name=name, domain=domain, ground=np.asarray, dt=1.0, reward="environment",
                    make_env=partial(made, domain))  # fmt: skip
        with task.bind() as bound, Trainer(bound, resolve("default"), seed) as trainer:
            start, solved = time.process_time(), []
            for _ in range(options.episodes):
                row = next(trainer.run())
                solved.append(row.terminated)
            speed = trainer.env_steps / (time.process_time() - start)
        print(f"{name}, seed {seed}: {np.mean(solved[9:]):.1%} solved, {speed:.0f} steps/s")


if __name__ == "__main__":
    main()
