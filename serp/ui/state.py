"""The state that `serp plan` plans from: given, initial or observed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

import click

from serp._util.text import did_you_mean, listed, plural
from serp.errors import SerpError
from serp.ui.asked import with_domain

if TYPE_CHECKING:
    from serp.model.domain import Domain
    from serp.model.transition_model import Vector
    from serp.tasks.task import Task
    from serp.ui.planner import ChosenPlanner


_MOST_STEPS: Final = 200
_MOST_SECONDS: Final = 10.0
"""Limits of the search for a state in which the planner has a choice."""

MakePlanner = Callable[["Domain"], "ChosenPlanner"]


def asked_state(
    domain: Domain,
    task: Task | None,
    make_planner: MakePlanner,
    assignments: Iterable[str],
    *,
    observe: bool,
    seed: int,
) -> tuple[Domain, Vector, str]:
    """Return the domain, grounded for the state to plan from; this state `[F]`; its origin.

    The state is what `assignments` say, the rest of it from the problem or, with `observe` or where
    nothing else is known, from the environment of the task after a reset with `seed`.
    """
    given = parse_state(assignments, domain)
    complete = all(fluent.name in given for fluent in domain.model.fluents)
    problem, grounded = domain.problem_syntax, domain
    if task is not None:
        grounded = domain.observed(given)
    elif given and problem is not None and problem.has_init:
        # What can be reached is reached from the given state.
        from serp.tasks.file_world import starting

        grounded = starting(domain, given)
    initial = grounded.model.initial_state
    if observe or (task is not None and not given and not complete and initial is None):
        # What --state changes is the state after the reset, whatever there is to choose.
        grounded, base, origin = _observed(domain, task, None if given else make_planner, seed)
    elif complete or initial is not None:
        base = {} if initial is None else grounded.model.values(initial)
        origin = "in the initial state of its problem"
        if complete:
            origin = "in the given state" if given else "in its only state"
    else:
        missing = [fluent.name for fluent in grounded.model.fluents if fluent.name not in given]
        other = "a problem file with an :init" if task is None else "the environment's: --observe"
        raise SerpError(
            f"{domain.source.name}: which state? --state gives no value of {listed(missing)}; give "
            f"these too, or {other}"
        )
    if given and not complete:
        origin += ", changed by --state"
    fluents = {fluent.name for fluent in grounded.model.fluents}
    for name in given.keys() - fluents:  # in a closed world it is part of the :init by now
        if grounded.supplied is not None or observe:
            raise SerpError(f"--state: `{name}` is fixed by the problem file; change it there")
        del given[name]
    return grounded, grounded.model.state({**base, **given}), origin


def _observed(
    domain: Domain, task: Task | None, make_planner: MakePlanner | None, seed: int
) -> tuple[Domain, dict[str, float | bool], str]:
    """Return the task's domain and an observed state, in which a planner, if any, has a choice."""
    if task is None:
        raise SerpError(
            f"--observe: no task is installed for domain `{domain.name}`, so there is no "
            "environment to observe; give the state with --state"
        )
    task = with_domain(task, domain)
    if domain.problem_syntax is not None:  # the grounding tells what of :init is observed
        with task.bind() as bound:
            domain = bound.domain
    state, origin = observed_state(task, make_planner and make_planner(domain), seed)
    return domain, domain.model.values(state), origin


def observed_state(task: Task, planner: ChosenPlanner | None, seed: int) -> tuple[Vector, str]:
    """Return the first observed state `[F]` in which a planner has a choice, and its origin.

    Where the planner is indifferent, its action is executed and the next state is tried; after an
    episode the next one begins. Without a planner, or where no such state is found, the state
    after the reset is returned.
    """
    deadline = time.monotonic() + _MOST_SECONDS
    origin = f"observed after a reset with seed {seed}"
    with task.bind() as bound:
        state = first = bound.ground(*bound.reset(seed), bound.env)
        for steps in range(_MOST_STEPS + 1):
            if planner is None:
                break
            plan = planner.plan(state)
            if plan.forecast.applicable.sum() > 1 and not plan.indifferent:
                walked = f" and {plural(steps, 'step')} without a choice" if steps else ""
                return state, origin + walked
            if plan.action is None or time.monotonic() > deadline:
                break
            action = bound.actions.environment_action[plan.action]
            raw, _, terminated, truncated, info = bound.step(action)
            if terminated or truncated:
                raw, info = bound.reset()
            state = bound.ground(raw, info, bound.env)
    return first, origin


def parse_state(
    assignments: Iterable[str], domain: Domain, said: str = "--state"
) -> dict[str, float]:
    """Return fluent → value of `fluent=value` texts, several in one text separated by commas.

    A predicate takes `true` or `false` as well as 1 or 0. `said` begins the messages.
    """
    state: dict[str, float] = {}
    for text in (part for whole in assignments for part in whole.split(",") if part.strip()):
        target, equals, value = text.partition("=")
        if not equals or not target.strip():
            raise click.UsageError(f"{said} {text}: expected fluent=value, such as pole-angle=0.05")
        name = " ".join(target.lower().strip().strip("()").split())
        declaration = domain.declared(name)
        if declaration is None:
            model = domain.model
            known = [*(fluent.name for fluent in model.fluents), *model.ground.static]
            raise SerpError(f"{said}: unknown fluent `{name}`; {did_you_mean(name, known)}")
        if name in state:
            raise SerpError(f"{said}: `{name}` is given twice")
        state[name] = _value(name, value.strip(), said, numeric=declaration.numeric)
    return state


def _value(name: str, text: str, said: str, *, numeric: bool) -> float:
    words = {} if numeric else {"true": 1.0, "false": 0.0}
    try:
        value = words[text.lower()] if text.lower() in words else float(text.replace("−", "-"))
    except ValueError:
        value = float("nan")
    if value - value != 0.0 or (not numeric and value not in (0.0, 1.0)):
        wanted = "a finite number" if numeric else "true or false"
        raise SerpError(f"{said}: `{name}` is {wanted}, not `{text}`")
    return value
