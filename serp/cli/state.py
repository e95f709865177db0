"""The state that `serp plan` plans from: given, initial or observed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import click

from serp._util.text import did_you_mean, listed
from serp.cli.asked import with_domain
from serp.errors import SerpError

if TYPE_CHECKING:
    from serp.model.loading import Domain
    from serp.model.transition_model import Vector
    from serp.planning.replanner import MonitorReplanner
    from serp.tasks.task import Task

MOST_STEPS: Final = 200
"""Steps after which the search for a state with a choice ends."""
_MOST_SECONDS: Final = 10.0


class AskedDomain(NamedTuple):
    """A domain, and the task that it belongs to, if any."""

    domain: Domain
    task: Task | None


def asked_state(
    asked: AskedDomain,
    planner_of: Callable[[Domain], MonitorReplanner],
    assignments: tuple[str, ...],
    *,
    observe: bool,
    seed: int,
) -> tuple[Domain, Vector, str]:
    """Return the state to plan from and its domain.

    Args:
        asked: The domain and its task.
        planner_of: Makes the planner of a domain.
        assignments: What `--state` says.
        observe: Whether the state comes from the environment.
        seed: Seed of the environment's reset.

    Returns:
        The domain, grounded for the state; the state `[F]`; where the state comes from.

    Raises:
        SerpError: A fluent has no value or a wrong one, or there is no environment to observe.
    """
    domain, given = asked.domain, parse_state(assignments, GroundNames(asked.domain))
    complete = all(fluent.name in given for fluent in domain.model.fluents)
    problem = domain.problem_syntax
    if observe:
        pass
    elif asked.task is None and problem is not None and problem.has_init:
        # What can be reached is reached from the given state.
        domain = domain.starting(given) if given else domain
    elif asked.task is not None:
        domain = domain.observed(given)
    model = domain.model
    missing = [fluent.name for fluent in model.fluents if fluent.name not in given]
    # What --state changes is the state after the reset, whatever there is to choose.
    choosing = None if given else planner_of
    if observe:
        domain, base, origin = _observed(asked, choosing, seed)
    elif complete:
        base = {} if model.initial_state is None else model.values(model.initial_state)
        origin = "in the given state" if given else "in its only state"
    elif model.initial_state is not None:
        base, origin = model.values(model.initial_state), "in the initial state of its problem"
    elif given:
        raise SerpError(f"--state leaves out {listed(missing)}; {_how_to_complete(asked)}")
    elif asked.task is not None:
        domain, base, origin = _observed(asked, choosing, seed)
    else:
        raise SerpError(
            f"{domain.source.name}: which state? Give one with --state, a value for each of "
            f"{listed(missing)}; or give a problem file with an :init"
        )
    if given and not complete:
        origin += ", changed by --state"
    fluents = {fluent.name for fluent in domain.model.fluents}
    for name in given.keys() - fluents:  # in a closed world it is part of the :init by now
        if domain.supplied is not None or observe:
            raise SerpError(f"--state: `{name}` is fixed by the problem file; change it there")
        del given[name]
    return domain, domain.model.state({**base, **given}), origin


def _how_to_complete(asked: AskedDomain) -> str:
    if asked.task is not None:
        return "give these too, or take them from the environment with --observe"
    return "give these too, or a problem file with an :init"


def _observed(
    asked: AskedDomain, planner_of: Callable[[Domain], MonitorReplanner] | None, seed: int
) -> tuple[Domain, dict[str, float | bool], str]:
    """Return the task's domain and a state: after a reset, or where a planner has a choice."""
    if asked.task is None:
        raise SerpError(
            f"--observe: no task is installed for domain `{asked.domain.name}`, so there is no "
            "environment to observe; give the state with --state"
        )
    task = with_domain(asked.task, asked.domain)
    domain = asked.domain
    if domain.problem_syntax is not None:  # the grounding tells what of :init is observed
        with task.bind() as bound:
            domain = bound.domain
    if planner_of is None:
        state, origin = observed(task, seed)
    else:
        state, origin = observed_choice(task, planner_of(domain), seed)
    return domain, domain.model.values(state), origin


def observed(task: Task, seed: int) -> tuple[Vector, str]:
    """Return the state `[F]` after a reset of a task's environment, and where it comes from."""
    with task.bind() as bound:
        raw, _ = bound.reset(seed)
        return bound.ground(raw), f"observed after a reset with seed {seed}"


def observed_choice(task: Task, planner: MonitorReplanner, seed: int) -> tuple[Vector, str]:
    """Return the first observed state in which the planner has a choice.

    Where the planner is indifferent, its action is executed and the next state is tried; after an
    episode the next one begins. Where no such state is found, the state after the reset is
    returned.

    Args:
        task: The task.
        planner: Its planner.
        seed: Seed of the reset.
    """
    deadline = time.monotonic() + _MOST_SECONDS
    with task.bind() as bound:
        raw, _ = bound.reset(seed)
        first = bound.ground(raw)
        origin = f"observed after a reset with seed {seed}"
        state, steps = first, 0
        while True:
            plan = planner.plan(state)
            if plan.forecast.applicable.sum() > 1 and not plan.indifferent:
                made = f" and {steps} step{'s' * (steps > 1)} without a choice"
                return state, origin + made * (steps > 0)
            if plan.action is None or steps == MOST_STEPS or time.monotonic() > deadline:
                return first, origin
            raw, _, terminated, truncated, _ = bound.step(
                bound.actions.environment_action[plan.action]
            )
            steps += 1
            if terminated or truncated:
                raw, _ = bound.reset()
            state = bound.ground(raw)


def parse_state(assignments: Iterable[str], known: Mapping[str, bool]) -> dict[str, float]:
    """Return fluent → value of `fluent=value` texts, several in one text separated by commas.

    Args:
        assignments: What was typed; a predicate takes `true` or `false` as well as 1 or 0.
        known: Name of every fluent → whether it is numeric.

    Raises:
        UsageError: A text has another form.
        SerpError: A fluent is unknown or given twice, or a value is none that it can have.
    """
    state: dict[str, float] = {}
    for text in (part for whole in assignments for part in whole.split(",") if part.strip()):
        target, equals, value = text.partition("=")
        if not equals or not target.strip():
            raise click.UsageError(
                f"--state {text}: expected fluent=value, such as pole-angle=0.05"
            )
        name = " ".join(target.lower().strip().strip("()").split())
        if name not in known:
            raise SerpError(f"--state: unknown fluent `{name}`; {did_you_mean(name, known)}")
        if name in state:
            raise SerpError(f"--state: `{name}` is given twice")
        state[name] = _fluent_value(name, value.strip(), numeric=known[name])
    return state


def _fluent_value(name: str, text: str, *, numeric: bool) -> float:
    words = {} if numeric else {"true": 1.0, "false": 0.0}
    try:
        value = words[text.lower()] if text.lower() in words else float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0.0 or (not numeric and value not in (0.0, 1.0)):
        wanted = "a finite number" if numeric else "true or false"
        raise SerpError(f"--state: `{name}` is {wanted}, not `{text}`")
    return value


class GroundNames(Mapping[str, bool]):
    """Every ground predicate and function of a domain → whether it is numeric.

    Those that are listed are the ones that its model names.
    """

    def __init__(self, domain: Domain) -> None:
        self._domain = domain

    def __getitem__(self, name: str) -> bool:
        declaration = self._domain.declared(name)
        if declaration is None:
            raise KeyError(name)
        return declaration.numeric

    def __iter__(self) -> Iterator[str]:
        model = self._domain.model
        yield from (fluent.name for fluent in model.fluents)
        yield from model.ground.static

    def __len__(self) -> int:
        return sum(1 for _ in self)
