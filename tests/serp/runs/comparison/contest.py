"""A small task to compare on, that other processes can import, and external learners."""

from __future__ import annotations

import contextlib
import csv
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from serp.errors import RunError
from serp.runs.comparison import algorithms
from serp.runs.comparison.algorithms import GROUP, find_algorithm
from serp.runs.comparison.compare import Comparison, compare
from serp.runs.comparison.plan import ComparisonProtocol
from serp.runs.comparison.trial import Measured, run_trial
from serp.runs.comparison.workers import Pool
from serp.runs.rollout import training_seed
from serp.runs.train import SIGNALS
from serp.tasks.task import Task
from tests.serp.sample_tasks import Corridor, corridor

PROTOCOL = ComparisonProtocol(
    env_steps=130, evaluate_every=50, evaluation_episodes=3, final_episodes=4, evaluation_seed=9
)
OWN = tuple(algorithms.OWN)
GUIDED = tuple(name for name in OWN if algorithms.OWN[name].kind == "guided")


class Walk(Corridor):
    """A corridor in which nothing outlives an episode; it says how the episode ended."""

    def reset(self, **options: Any) -> Any:
        self.clock, self.slips = 0, 0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)

    def step(self, action: int) -> Any:
        before = self.x
        seen, reward, terminated, truncated, info = super().step(action)
        self.slips += self.x == before
        info |= {"slips": self.slips}
        if terminated:
            info["outcome"] = "goal" if self.x > 0 else "pit"
        return seen, reward, terminated, truncated, info


class Pothole(Walk):
    """Raises in the second episode of every trial with seed 1."""

    def reset(self, *, seed: int | None = None, **options: Any) -> Any:
        if seed == BAD_SEED:
            raise ConnectionError("cable cut")
        return super().reset(seed=seed, **options)


class Deadly(Walk):
    """Ends its process there, as the system does where memory is short."""

    def reset(self, *, seed: int | None = None, **options: Any) -> Any:
        if seed == BAD_SEED:
            os._exit(9)
        return super().reset(seed=seed, **options)


class Signalled(Walk):
    """Gets at every reset the signals that a terminal and a scheduler send to all of a group."""

    def reset(self, *, seed: int | None = None, **options: Any) -> Any:
        if multiprocessing.parent_process() is not None:
            for number in SIGNALS:
                os.kill(os.getpid(), number)
        return super().reset(seed=seed, **options)


BAD_SEED = training_seed(1, 1)
"""The second episode of every trial with seed 1."""


def ground(seen: Any) -> dict[str, float]:
    return {"x": float(seen[0])}


def walk(folder: Path, make_env: Callable[..., gym.Env[Any, Any]] = Walk, **changes: Any) -> Task:
    """The task, with the domain file in a folder."""
    given = {"ground": ground, "counters": ("slips",), "name": "walk", **changes}
    return corridor(folder, make_env, **given)


def measured(
    folder: Path,
    algorithm: str = "serp",
    *,
    task: Task | None = None,
    seed: int = 0,
    protocol: ComparisonProtocol = PROTOCOL,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
    on_progress: Callable[[int], None] = lambda steps: None,
) -> Measured:
    """Run one trial."""
    found, chosen = find_algorithm(algorithm), task or walk(folder)
    settings = found.settings(chosen, changes or {})
    return run_trial(found, chosen, settings, seed, protocol, on_progress)


def episodes_of(found: Measured) -> list[Any]:
    """The rows of the episodes, but for the time they took."""
    return [(row._replace(seconds=0.0), counts) for row, counts in found.log.rows]


def small(
    task: Task | str | None, out: Path, *, report: bool = False, **options: Any
) -> Comparison:
    """Compare with a budget that takes no time, in this process.

    The report takes longer than all the training here, and its pictures longer still.
    """
    given: dict[str, Any] = {"jobs": 1, "quiet": True}
    if not (out / "plan.json").exists():
        given |= {"algorithms": ["serp", "dqn"], "seeds": 2, "env_steps": 60, "evaluate_every": 30}
        given |= {"evaluation_episodes": 2, "final_episodes": 2}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.comparison.report.render", lambda figure, kind: b"<svg/>")
        if not report:
            patch.setattr("serp.runs.comparison.report.write_report", lambda folder, results: None)
        return compare(task, out=out, **{**given, **options})


def trials_in(folder: Path) -> dict[str, tuple[int, int]]:
    """Every complete trial with what tells whether it was written again."""
    found = {}
    for done in sorted(folder.glob("trials/*/*/*/trial.json")):
        status = done.stat()
        name = "/".join(done.parent.relative_to(folder / "trials").parts)
        found[name] = (status.st_ino, status.st_mtime_ns)
    return found


def everything(folder: Path) -> dict[str, Any]:
    """What all trials have found, but for the time they took."""
    found: dict[str, Any] = {}
    for done in sorted(folder.glob("trials/*/*/*/trial.json")):
        place = done.parent
        name = str(place.relative_to(folder))
        with open(place / "episodes.csv", newline="") as file:
            rows = [{**row, "seconds": ""} for row in csv.DictReader(file)]
        found[name] = (rows, (place / "evaluations.csv").read_bytes())
    return found


@contextlib.contextmanager
def threads(address: str | None, most: int | None) -> Iterator[Pool]:
    """An engine."""
    assert (address, most) == ("there:1", 2)
    with ThreadPoolExecutor(1) as executor:
        yield Pool(executor, 2)


# External learners --------------------------------------------------------------------------------


class Drawing:
    """Draws its actions.

    What it has learned is how many steps it has made.
    """

    characteristics: Mapping[str, str] = {"learner": "none", "who acts": "chance"}

    def __init__(self, env: gym.Env[Any, Any], task: str, seed: int) -> None:
        self.env = env
        self.random = np.random.default_rng(seed)
        self.learned = 0

    def learn(self, env_steps: int) -> None:
        self.env.reset(seed=int(self.random.integers(9)))
        for _ in range(env_steps):
            space: Any = self.env.action_space
            _, _, terminated, truncated, _ = self.env.step(self.random.integers(space.n))
            if terminated or truncated:
                self.env.reset()
        self.learned += env_steps

    def act(self, inputs: NDArray[np.float32]) -> NDArray[np.int64]:
        """Go right once it has learned."""
        return np.full(len(inputs), 1 if self.learned else 2)


class Lazy(Drawing):
    """Ends too early."""

    def learn(self, env_steps: int) -> None:
        super().learn(env_steps - 10)


class Greedy(Drawing):
    """Makes more steps than it was given."""

    def learn(self, env_steps: int) -> None:
        super().learn(env_steps + 10)


class Faulty(Drawing):
    """Fails as other people's libraries do."""

    def learn(self, env_steps: int) -> None:
        super().learn(10)
        raise ValueError("expected scalar type Float but found Double")


class Absent(Drawing):
    """Needs what is not there."""

    def __init__(self, *arguments: Any) -> None:
        raise RunError("it needs more memory than there is")


def external_algorithms() -> dict[str, EntryPoint]:
    """Entry points, as an installed package would offer them."""
    made = (Drawing, Lazy, Greedy, Faulty, Absent)
    return {
        each.__name__.lower(): EntryPoint(
            each.__name__.lower(), f"{__name__}:{each.__name__}", GROUP
        )
        for each in made
    }
