"""Puzzles that are new in every episode: how many are solved in a training with default settings.

    python -m tests.benchmarks.study_new_worlds [--episodes 50] [--seeds 2]

`push`: three boxes in a room of 6 × 6 cells have to be pushed onto three cells, `push-5` two boxes
in 5 × 5. `delivery`: a van that holds one item has to bring six of them to a depot. Boxes, items,
player and van begin in other places in every episode. Printed are the share of the episodes from
the tenth on that reach the goal, and env steps per second of processor time.
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
MOVES = {"north": (0, -1), "south": (0, 1), "west": (-1, 0), "east": (1, 0)}
WORLDS = {"push": ("push", 6, 3), "push-5": ("push", 5, 2), "delivery": ("delivery", 4, 6)}
"""Name → domain, cells in a row, and boxes or items."""


class NewWorld(FileWorld):
    """A world with another initial state in every episode."""

    def __init__(self, domain: Domain, size: int, count: int) -> None:
        super().__init__(domain)
        self.size, self.count = size, count
        self.place = {fluent.name: k for k, fluent in enumerate(self.model.fluents)}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        state = np.zeros_like(self._start)
        cells = [f"c{x}{y}" for x, y in product(range(self.size), repeat=2)]
        inner = [f"c{x}{y}" for x, y in product(range(1, self.size - 1), repeat=2)]
        if "player c00" in self.place:
            boxes = self.np_random.choice(inner, self.count, replace=False).tolist()
            free = [cell for cell in cells if cell not in boxes]
            names = [f"box {cell}" for cell in boxes]
            names += [f"player {self.np_random.choice(free)}"]
        else:
            names = [f"at i{k} {self.np_random.choice(cells[1:])}" for k in range(self.count)]
            names += [f"van {self.np_random.choice(cells)}", "empty"]
        for name in names:
            state[self.place[name]] = 1.0
        self.state = state
        return state.copy(), {}


def problem(domain: str, size: int, count: int) -> str:
    """Return a problem with a room of `size` × `size` cells."""
    cells = list(product(range(size), repeat=2))
    facts = [
        f"(next c{x}{y} c{x + dx}{y + dy} {name})"
        for x, y in cells
        for name, (dx, dy) in MOVES.items()
        if (x + dx, y + dy) in cells
    ]
    things = " ".join(f"c{x}{y}" for x, y in cells) + " - cell "
    if domain == "push":
        start = "(player c00) " + " ".join(f"(box c{k + 1}1)" for k in range(count))
        goal = " ".join(f"(box c{k + 1}{size // 2})" for k in range(count))
    else:
        start = "(van c00) (empty) " + " ".join(f"(at i{k} c11)" for k in range(count))
        goal = " ".join(f"(at i{k} c00)" for k in range(count))
        things += " ".join(f"i{k}" for k in range(count)) + " - item"
    return (
        f"(define (problem {domain}) (:domain {domain}) (:objects {things})\n"
        f"(:init {start} {' '.join(facts)})\n(:goal (and {goal})))\n"
    )


def made(domain: Domain, size: int, count: int) -> TimeLimit[Any, Any, Any, Any]:
    """Return the environment."""
    return TimeLimit(NewWorld(domain, size, count), 200)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    for name, seed in product(options.worlds or WORLDS, range(options.seeds)):
        domain_name, size, count = WORLDS[name]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{name}.pddl"
            file.write_text(problem(domain_name, size, count), encoding="utf-8")
            domain = load_domain(FILES / f"{domain_name}.pddl", file)
        make = partial(made, domain, size, count)
        task = Task(name=name, domain=domain, ground=np.asarray, dt=1.0, reward="environment",
                    make_env=make)  # fmt: skip
        with task.bind() as bound, Trainer(bound, resolve("default"), seed) as trainer:
            trainer.prepare()
            start, solved = time.process_time(), []
            for _ in range(options.episodes):
                row = trainer.run_episode()
                solved.append(row.terminated)
            speed = trainer.env_steps / (time.process_time() - start)
        print(f"{name}, seed {seed}: {np.mean(solved[9:]):.1%} solved, {speed:.0f} steps/s")


if __name__ == "__main__":
    main()
