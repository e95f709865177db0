"""A small task to compare on, that other processes can import, and external learners."""

import contextlib
import csv
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from serp.errors import RunError
from serp.runs.comparison.algorithms import GROUP, find_algorithm
from serp.runs.comparison.compare import Comparison, compare
from serp.runs.comparison.trial import Job, Trial, TrialProtocol
from serp.runs.rollout import training_seed
from serp.tasks.task import Task
from tests.serp.sample_tasks import Corridor, corridor

PROTOCOL = TrialProtocol(env_steps=130, evaluate_every=50, evaluation_episodes=3, final_episodes=4)


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


BAD_SEED = training_seed(1, 1)
"""The second episode of every trial with seed 1."""


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


def ground(seen: Any) -> dict[str, float]:
    return {"x": float(seen[0])}


def walk(folder: Path, make_env: Callable[..., gym.Env[Any, Any]] = Walk, **changes: Any) -> Task:
    """The task, with the domain file in a folder."""
    given = {"ground": ground, "counters": ("slips",), "name": "walk", **changes}
    return corridor(folder, make_env, **given)


def job(
    task: Task, algorithm: str, folder: Path, *, seed: int = 0, protocol: TrialProtocol = PROTOCOL
) -> Job:
    """A trial with a folder."""
    found = find_algorithm(algorithm)
    settings = found.settings(task, {})
    return Job(Trial(algorithm, seed), found, task.loaded(), settings, protocol, folder)


def small(
    task: Task | str | None, out: Path, *, report: bool = False, **options: Any
) -> Comparison:
    """Compare with a budget that takes no time, in this process, without a report or pictures."""
    given: dict[str, Any] = {"jobs": 1, "quiet": True}
    if not (out / "plan.json").exists():
        given |= {"algorithms": ["serp", "dqn"], "seeds": 2, "env_steps": 60, "evaluate_every": 30}
        given |= {"evaluation_episodes": 2, "final_episodes": 2}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.comparison.report.render", lambda figure, kind: b"<svg/>")
        if not report:
            patch.setattr("serp.runs.comparison.report.write_report", lambda *arguments: None)
        return compare(task, out=out, **{**given, **options})


def trials_in(folder: Path) -> dict[str, tuple[int, int]]:
    """Every trial with what tells whether it was written again."""
    status = {file.parent.name: file.stat() for file in folder.glob("trials/*/evaluations.csv")}
    return {name: (each.st_ino, each.st_mtime_ns) for name, each in status.items()}


def found_in(trial: Path) -> Any:
    """What a trial has found, but for the time that it took."""
    with open(trial / "metrics.csv", newline="") as file:
        rows = [{**row, "wall_time": ""} for row in csv.DictReader(file)]
    return rows, (trial / "evaluations.csv").read_text(), (trial / "decisions.csv").read_text()


def everything(folder: Path) -> dict[str, Any]:
    """What all trials have found."""
    return {trial.name: found_in(trial) for trial in sorted(folder.glob("trials/*"))}


@contextlib.contextmanager
def threads(address: str | None, most: int | None) -> Iterator[tuple[Executor, int]]:
    """An engine."""
    assert (address, most) == ("there:1", 2)
    with ThreadPoolExecutor(1) as executor:
        yield executor, 2


# External learners --------------------------------------------------------------------------------


class Drawing:
    """Draws its actions.

    What it has learned is how many steps it has made.
    """

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


class Odd(Drawing):
    """Returns what is no action."""

    def act(self, inputs: NDArray[np.float32]) -> Any:
        return np.full(len(inputs), 7)


class Absent(Drawing):
    """Needs what is not there."""

    def __init__(self, *arguments: Any) -> None:
        raise RunError("it needs more memory than there is")


def external_algorithms() -> dict[str, EntryPoint]:
    """Entry points, as an installed package would offer them."""
    made = (Drawing, Lazy, Greedy, Faulty, Odd, Absent)
    return {
        each.__name__.lower(): EntryPoint(
            each.__name__.lower(), f"{__name__}:{each.__name__}", GROUP
        )
        for each in made
    }
