"""An environment made of a domain file and its problem alone, and the task that plays it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import TimeLimit

from serp._util.numbers import real
from serp.errors import TaskError
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.loading import Domain, load_domain
from serp.model.transition_model import Vector
from serp.pddl.source import DomainError
from serp.tasks.task import Task

MAX_STEPS: Final = 1_000
"""Steps after which an episode is cut off, unless told otherwise."""


class FileWorld(gym.Env[Vector, int]):
    """The world of a domain file: it is what the file says, but that actions may fail.

    An observation is the state, float64 `[F]`: the fluents in the order of `model.fluents`, a
    predicate 0 or 1. Action n is the n-th ground action. An episode begins in the problem's `:init`
    and terminates where the goal is reached or `(terminal)` becomes true. The reward is the file's.

    An action whose precondition does not hold does nothing, and any other one does nothing with
    probability `failure`; processes and events take place all the same. The info of a step has
    `applied`, whether the action had its effects, and `unsafe`, whether the file flags the step.

    Args:
        domain: Domain and problem.
        failure: Probability, in [0, 1), that an action does nothing.
        dt: Control period in the time unit of the domain's rates.

    Raises:
        DomainError: There are no actions, or there is no problem with an `:init`.
        TaskError: `failure` is no such probability.
    """

    def __init__(self, domain: Domain, *, failure: float = 0.0, dt: float = 1.0) -> None:
        chance = real(failure)
        if chance is None or not 0.0 <= chance < 1.0:
            raise TaskError(f"failure must be a probability, at least 0 and below 1: {failure!r}")
        domain = domain.closed()
        self.model = domain.model.replace(dt=dt)
        self._start = _initial_state(domain)
        self._failure = chance
        self._state = self._start.tolist()
        free = np.array([fluent.numeric for fluent in self.model.fluents], dtype=np.bool_)
        self.observation_space = spaces.Box(
            np.where(free, -np.inf, 0.0), np.where(free, np.inf, 1.0), dtype=np.float64
        )
        self.action_space = spaces.Discrete(len(self.model.actions))  # type: ignore[assignment]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Return to the problem's `:init`; see `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        self._state = self._start.tolist()
        return np.array(self._start), {}

    def step(self, action: int) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Carry out an action; see `gymnasium.Env.step`.

        Raises:
            TaskError: The step has no result, such as after a division by zero.
        """
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is no action of {self.action_space}")
        fails = self._failure > 0.0 and self.np_random.random() < self._failure
        model, out, flags = self.model, [0.0], 0
        if not fails:
            out, flags = model.transition(self._state, int(action))
        applied = bool(flags & APPLICABLE)
        if not flags & (APPLICABLE | UNDEFINED):
            out, flags = model.transition(self._state, -1)
        if not flags & APPLICABLE:
            name = "waiting" if fails else model.actions[action].name
            raise TaskError(
                f"{model.ground.syntax.place.source.name}: the step `{name}` has no result in "
                f"{model.values(np.array(self._state))}: it divides by zero, is not finite, or "
                "contradicts itself"
            )
        reward = out.pop()
        self._state = out
        info = {"applied": applied, "unsafe": bool(flags & UNSAFE)}
        return np.array(out), reward, bool(flags & TERMINAL), False, info


def file_task(
    domain: str | Path | Domain,
    problem: str | Path | None = None,
    *,
    failure: float = 0.0,
    dt: float = 1.0,
    max_steps: int = MAX_STEPS,
) -> Task:
    """Return a task whose environment is made of the file: `FileWorld`.

    Args:
        domain: The domain file, or a loaded domain.
        problem: The problem file; by default `<name>-problem.pddl` beside the domain file.
        failure: Probability, in [0, 1), that an action does nothing.
        dt: Control period in the time unit of the domain's rates.
        max_steps: Steps after which an episode is cut off.

    Raises:
        DomainError: A file is missing or wrong.
    """
    if not isinstance(domain, Domain):
        domain = load_domain(domain, problem)
    return Task(
        name=f"{domain.name}-world",
        make_env=partial(_made, domain, failure=failure, dt=dt, max_steps=max_steps),
        domain=domain,
        ground=_state,
        dt=dt,
        closed=True,
        reward="environment",  # the file's, less that of actions that failed
        description=f"the world that {Path(domain.source.name).name} describes",
    )


def _state(observation: Vector) -> Vector:
    return observation


def _made(domain: Domain, *, failure: float, dt: float, max_steps: int) -> gym.Env[Any, Any]:
    return TimeLimit(FileWorld(domain, failure=failure, dt=dt), max_episode_steps=max_steps)


def _initial_state(domain: Domain) -> Vector:
    model, problem = domain.model, domain.problem_syntax
    if not model.actions:
        raise DomainError("there is no action that can ever be carried out", domain.syntax.place)
    if problem is None or not problem.has_init:
        raise DomainError(
            "a world made of a file begins in the :init of a problem, and there is none",
            domain.syntax.place if problem is None else problem.place,
            f"write `(:init ...)` in a problem file, by default {domain.syntax.name}-problem.pddl "
            "beside the domain file",
        )
    assert model.initial_state is not None  # numbers that :init leaves out are 0
    return model.initial_state
