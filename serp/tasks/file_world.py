"""An environment made of a domain file and its problem alone, and the task that plays it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import TimeLimit
from pydantic import Field, model_validator

from serp._util.did_you_mean import did_you_mean
from serp._util.numbers import COUNTED
from serp.errors import TaskError
from serp.model.domain import Domain, load_domain, problem_beside
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.traced_step import Passage
from serp.model.transition_model import Vector
from serp.pddl.parser import parse_problem
from serp.pddl.source import DomainError, Edit, Source, edited
from serp.settings import Section
from serp.tasks.task import Task

Chance = Annotated[float, Field(ge=0, lt=1)]


class WorldOptions(Section):
    """The options of a world that is made from a file (`serp.file_task`)."""

    failure: Chance = 0.0
    """Probability that an action does nothing."""
    slip: Chance = 0.0
    """Probability that another action happens instead: one of those whose precondition holds, each
    as likely as the others. If there is none, nothing happens."""
    noise: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Standard deviation of the change in a number, as a share of this change. A change by d that
    actions and processes make becomes d · (1 + noise · z), with z from the standard normal
    distribution, before events are checked."""
    max_steps: Annotated[int, Field(ge=1, le=COUNTED)] = 1_000
    """Steps after which an episode is cut off."""

    @model_validator(mode="after")
    def _something_may_work(self) -> Self:
        if self.failure + self.slip > 1.0:
            raise ValueError(
                f"failure and world.slip are {self.failure!r} and {self.slip!r}; an action fails, "
                "slips or is carried out, so the two must add up to at most 1"
            )
        return self

    @classmethod
    def section(cls) -> str:
        """Return what messages call the options."""
        return "world"


def starting(domain: Domain, values: Mapping[str, float | bool]) -> Domain:
    """Return the same domain with other values in the `:init` of its problem.

    All else in the problem stays as it is. Where there is no problem, or no `:init` in it, numbers
    begin at 0 and predicates as false, unless values are given.

    Raises:
        DomainError: There is no predicate or function of such a name.
    """
    stated, problem = {}, domain.problem_syntax
    if problem is not None:
        atoms = [" ".join((a.name, *(t.name for t in a.arguments))) for a in problem.true_atoms]
        stated = {name: f"({name})" for name in atoms}
        for function, number in problem.values:
            name = " ".join((function.name, *(t.name for t in function.arguments)))
            stated[name] = f"(= ({name}) {number.place.text})"
    for name, value in values.items():
        declaration = domain.declared(name)
        if declaration is None:
            known = [*(fluent.name for fluent in domain.model.fluents), *stated]
            raise DomainError(
                f"{domain.source.name}: there is no `{name}`",
                advice=did_you_mean(name, known),
                code="unknown-name",
            )
        if declaration.numeric:
            stated[name] = f"(= ({name}) {np.format_float_positional(value, trim='0')})"
        elif value:
            stated[name] = f"({name})"
        else:
            stated.pop(name, None)
    init = "\n    ".join(["(:init", *stated.values()]) + ")"
    source = _with_init(domain, init)
    return dataclasses.replace(
        domain, problem_source=source, problem_syntax=parse_problem(source, domain.syntax)
    )


def _with_init(domain: Domain, init: str) -> Source:
    """Return the problem file with another `:init`; one that has nothing else if there is none."""
    before = domain.problem_source
    if before is None:
        name = str(problem_beside(Path(domain.source.name)))
        text = f"(define (problem start)\n  (:domain {domain.name})\n  {init}\n  (:goal (and)))\n"
        return Source(name, text)
    assert domain.problem_syntax is not None
    old, end = domain.problem_syntax.init, domain.problem_syntax.place.end - 1
    # A new one stands before the last parenthesis.
    edit = Edit(old.start, old.end, init) if old else Edit(end, end, f"\n  {init}")
    return Source(before.name, edited(before.text, [edit]))


class Happened(NamedTuple):
    """What took place in a step of a world."""

    action: int  # position of the ground action that was carried out; -1 for none
    outcome: int  # of the action, from 0; see `GroundSchema.outcomes`
    flags: int
    passages: Callable[[], list[Passage]]  # effects, rates and events that took part, in order


class FileWorld(gym.Env[Vector, int]):
    """The world of a domain file: it is what the file says, but for disturbances.

    An observation is the state, float64 `[F]`: the fluents in the order of `model.fluents`, a
    predicate 0 or 1. Action n is the n-th ground action. An episode begins in the problem's `:init`
    and terminates where the goal is reached or `(terminal)` becomes true. The reward is the file's.

    An action whose precondition does not hold does nothing, and any other one may fail or slip as
    the options say; processes and events take place all the same. The info of a step has `applied`,
    whether the chosen action had its effects, and `unsafe`, whether the file flags the step.

    Args:
        domain: Domain and problem.
        options: Disturbances; none by default.
        dt: Control period in the time unit of the domain's rates.

    Attributes:
        model: The model of the file.
        state: The state now, `[F]`; an assignment puts the world into another one.
        happened: What took place in the last step.

    Raises:
        DomainError: There are no actions, or there is no problem with an `:init`.
    """

    def __init__(
        self, domain: Domain, options: WorldOptions | None = None, *, dt: float = 1.0
    ) -> None:
        domain = domain.closed()
        self.model = domain.model.replace(dt=dt)
        self._start = _initial_state(domain)
        self._options = options or WorldOptions()
        self.state = self._start
        self.happened = Happened(-1, 0, 0, list)
        self._numeric = np.array([f.numeric for f in self.model.fluents], dtype=np.bool_)
        self.observation_space = spaces.Box(
            np.where(self._numeric, -np.inf, 0.0),
            np.where(self._numeric, np.inf, 1.0),
            dtype=np.float64,
        )
        self.action_space = spaces.Discrete(len(self.model.actions))  # type: ignore[assignment]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Return to the problem's `:init`; see `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        self.state = self._start
        return self.state.copy(), {}

    def step(self, action: int) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Carry out an action; see `gymnasium.Env.step`.

        Raises:
            TaskError: The step has no result, such as after a division by zero.
        """
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is not an action of {self.action_space}")
        done = self._disturbed(int(action))
        outcome = self._drawn(done)
        out, flags, trace = self._carried_out(done, outcome)
        if not flags & (APPLICABLE | UNDEFINED):
            done, outcome = -1, 0
            out, flags, trace = self._carried_out(done, outcome)
        model = self.model
        if not flags & APPLICABLE:
            name = "waiting" if done < 0 else model.actions[done].name
            raise TaskError(
                f"{model.ground.syntax.place.source.name}: the step `{name}` has no result in "
                f"{model.values(self.state)}: a value is not finite, or effects "
                "contradict each other"
            )
        reward = out.pop()
        self.state, self.happened = np.array(out), Happened(done, outcome, flags, trace)
        info = {"applied": done == action, "unsafe": bool(flags & UNSAFE)}
        return self.state.copy(), reward, bool(flags & TERMINAL), False, info

    def _disturbed(self, action: int) -> int:
        """Return the action that takes place where one was chosen; -1 for none."""
        failure, slip = self._options.failure, self._options.slip
        if failure + slip == 0.0:
            return action
        drawn = self.np_random.random()
        if drawn < failure:
            return -1
        if drawn >= failure + slip:
            return action
        state, count = self.state.tolist(), len(self.model.actions)
        possible = (k for k in range(count) if self.model.transition(state, k)[1] & APPLICABLE)
        others = [k for k in possible if k != action]
        return others[int(self.np_random.integers(len(others)))] if others else -1

    def _drawn(self, action: int) -> int:
        """Draw the outcome of an action that has several."""
        outcomes = self.model.actions[action].outcomes if action >= 0 else ()
        if not outcomes:
            return 0
        ends = np.cumsum([outcome.probability for outcome in reversed(outcomes)])[::-1]
        return int((self.np_random.random() < ends).sum())

    def _carried_out(
        self, action: int, outcome: int
    ) -> tuple[list[float], int, Callable[[], list[Passage]]]:
        """Return next state and reward, the flags, and what returns the passages."""
        state = self.state.tolist()
        if self._options.noise > 0.0 or outcome:
            amend = self._scatter if self._options.noise > 0.0 else None
            out, flags, passages = self.model.traced(state, action, amend=amend, outcome=outcome)
            return out, flags, lambda: passages
        if action >= 0 and self.model.actions[action].outcomes:
            table, flags = self.model.written_core().step_of_outcome(self.state, action, 0)
            out = table.tolist()
        else:
            out, flags = self.model.transition(state, action)
        return out, flags, lambda: self.model.traced(state, action).passages

    def _scatter(self, state: list[float], action: int, out: list[float]) -> None:
        """Make the changes of numbers larger or smaller by chance."""
        before, after = np.array(state), np.array(out[: len(state)])
        change = np.where(self._numeric, after - before, 0.0)
        drawn = self.np_random.standard_normal(len(change))
        out[: len(state)] = (after + self._options.noise * drawn * change).tolist()


def file_task(
    domain: str | Path | Domain,
    problem: str | Path | None = None,
    *,
    dt: float = 1.0,
    **options: Any,
) -> Task:
    """Return a task whose environment is made of the file: `FileWorld`.

    The planner and the learner's vetoes have the file's model, which knows of no disturbance.

    Args:
        domain: The domain file, or a loaded domain.
        problem: The problem file; by default `<name>-problem.pddl` beside the domain file.
        dt: Control period in the time unit of the domain's rates.
        **options: `failure`, `slip`, `noise` and `max_steps`, see `WorldOptions`.

    Raises:
        DomainError: A file is missing or wrong.
        SettingsError: There is no such option, or it is out of its range.
    """
    loaded = domain if isinstance(domain, Domain) else load_domain(domain, problem)
    return world_task(loaded, WorldOptions(**options), dt)


def world_task(domain: Domain, options: WorldOptions, dt: float) -> Task:
    """Return the task of a world that is made of a file; see `file_task`."""
    return Task(
        name=f"{domain.name}-world",
        make_env=partial(_made, domain, options, dt),
        domain=domain,
        ground=_state,
        dt=dt,
        world=options,
        reward="environment",  # the file's, less that of actions that failed
        description=f"the world that {Path(domain.source.name).name} describes",
    )


def _state(observation: Vector) -> Vector:
    return observation


def _made(domain: Domain, options: WorldOptions, dt: float) -> gym.Env[Any, Any]:
    return TimeLimit(FileWorld(domain, options, dt=dt), max_episode_steps=options.max_steps)


def _initial_state(domain: Domain) -> Vector:
    model, problem = domain.model, domain.problem_syntax
    if not model.actions:
        raise DomainError(
            "no action can ever be carried out", domain.syntax.place, code="no-action"
        )
    if problem is None or not problem.has_init:
        raise DomainError(
            "a world made from a file begins in the :init of a problem, but no :init was found",
            domain.syntax.place if problem is None else problem.place,
            f"write `(:init ...)` in a problem file, by default {domain.syntax.name}-problem.pddl "
            "beside the domain file",
            code="missing-value",
        )
    assert model.initial_state is not None  # numbers that :init leaves out are 0
    return model.initial_state
