"""A small task to compare on, that other processes can import, and external learners."""

import contextlib
import csv
import os
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import EntryPoint

import numpy as np

from serp.errors import RunError
from serp.runs.comparison.algorithms import GROUP, find_algorithm
from serp.runs.comparison.trial import Job, TrialProtocol
from serp.runs.rollout import training_seed
from tests.serp.sample_tasks import Corridor, corridor

PROTOCOL = TrialProtocol(env_steps=130, evaluate_every=50, evaluation_episodes=3, final_episodes=4)


class Walk(Corridor):
    """A corridor in which nothing outlives an episode; it says how the episode ended."""

    def reset(self, **options):
        self.clock, self.slips, self.wind = 0, 0, 0.0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)

    def step(self, action):
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

    def reset(self, *, seed=None, **options):
        if seed == BAD_SEED:
            raise ConnectionError("cable cut")
        return super().reset(seed=seed, **options)


class Deadly(Walk):
    """Ends its process there, as the system does where memory is short."""

    def reset(self, *, seed=None, **options):
        if seed == BAD_SEED:
            os._exit(9)
        return super().reset(seed=seed, **options)


def ground(seen):
    return {"x": float(seen[0])}


def walk(folder, make_env=Walk, **changes):
    """The task, with the domain file in a folder."""
    given = {"ground": ground, "counters": ("slips",), "name": "walk", **changes}
    return corridor(folder, make_env, **given)


def job(task, algorithm, folder, *, seed=0, protocol=PROTOCOL):
    """A trial with a folder."""
    found = find_algorithm(algorithm)
    settings = found.settings(task, {})
    return Job(found, seed, task.loaded(), settings, protocol, folder)


def small(task, out, *, report=False, **options):
    """Compare with a budget that takes no time, in this process, without a report or pictures."""
    import pytest  # not by the processes of trials, which import this module

    from serp.runs.comparison.compare import compare

    given = {"jobs": 1, "quiet": True}
    if not (out / "plan.json").exists():
        given |= {"algorithms": ["serp", "dqn"], "seeds": 2, "env_steps": 60, "evaluate_every": 30}
        given |= {"evaluation_episodes": 2, "final_episodes": 2}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.comparison.report.render", lambda figure, kind: b"<svg/>")
        if not report:
            patch.setattr("serp.runs.comparison.report.write_report", lambda *arguments: None)
        return compare(task, out=out, **{**given, **options})


def trials_in(folder):
    """Every trial with what tells whether it was written again."""
    status = {file.parent.name: file.stat() for file in folder.glob("trials/*/evaluations.csv")}
    return {name: (each.st_ino, each.st_mtime_ns) for name, each in status.items()}


def found_in(trial):
    """What a trial has found, but for the time that it took."""
    with open(trial / "metrics.csv", newline="") as file:
        rows = [{**row, "wall_time": ""} for row in csv.DictReader(file)]
    return rows, (trial / "evaluations.csv").read_text(), (trial / "decisions.csv").read_text()


def everything(folder):
    """What all trials have found."""
    return {trial.name: found_in(trial) for trial in sorted(folder.glob("trials/*"))}


@contextlib.contextmanager
def threads(address, most):
    """An engine."""
    assert (address, most) == ("there:1", 2)
    with ThreadPoolExecutor(1) as executor:
        yield executor, 2


def onward(state):
    """Return the action that leads to the goal."""
    return "right"


# External learners --------------------------------------------------------------------------------


class Drawing:
    """Draws its actions.

    What it has learned is how many steps it has made.
    """

    def __init__(self, env, task, seed):
        self.env = env
        self.random = np.random.default_rng(seed)
        self.learned = 0

    def learn(self, env_steps):
        self.env.reset(seed=int(self.random.integers(9)))
        for _ in range(env_steps):
            space = self.env.action_space
            _, _, terminated, truncated, _ = self.env.step(self.random.integers(space.n))
            if terminated or truncated:
                self.env.reset()
        self.learned += env_steps

    def act(self, inputs):
        """Go right once it has learned."""
        return np.full(len(inputs), 1 if self.learned else 2)


class Lazy(Drawing):
    """Ends too early."""

    def learn(self, env_steps):
        super().learn(env_steps - 10)


class Masked(Drawing):
    """Goes left, to the pit, as far as the file allows."""

    masked = True

    def act(self, inputs, masks):
        """Take the first action that is allowed."""
        assert masks.shape == (1, 4) and masks[0, 1:].all()
        return masks.argmax(axis=1)


class Late(Drawing):
    """Learns after more steps than there are."""

    first_update = 61


class Faulty(Drawing):
    """Fails as other people's libraries do."""

    def learn(self, env_steps):
        super().learn(10)
        raise ValueError("expected scalar type Float but found Double")


class Absent(Drawing):
    """Needs what is not there."""

    def __init__(self, *arguments):
        raise RunError("it needs more memory than there is")


def external_algorithms():
    """Entry points, as an installed package would offer them."""
    made = (Drawing, Masked, Lazy, Late, Faulty, Absent)
    return {
        each.__name__.lower(): EntryPoint(
            each.__name__.lower(), f"{__name__}:{each.__name__}", GROUP
        )
        for each in made
    }
