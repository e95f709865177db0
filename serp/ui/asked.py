"""What a command is asked for: a domain, a task, a run, a state."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.did_you_mean import did_you_mean, listed
from serp._util.text import plural
from serp.errors import SerpError
from serp.ui.options import own_task_name
from serp.ui.root import say

if TYPE_CHECKING:
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.model.domain import Domain
    from serp.model.transition_model import Vector
    from serp.planning.replanner import MonitorReplanner, Plan
    from serp.runs.run import Run
    from serp.tasks.environment import BoundTask
    from serp.tasks.task import Task

MakePlanner = Callable[["Domain"], "ChosenPlanner"]


def asked_own_task() -> Task | None:
    """Return the task that `--task` names, or None where it is not given."""
    name = own_task_name()
    if name is None:
        return None
    from serp.tasks.registry import custom_task

    return custom_task(name)


def asked_task(domain: str | None) -> Task | None:
    """Return the task that `--task` and `--domain` mean together; None where neither is given.

    `--domain` is an installed task or a domain file; beside `--task`, another domain file for it.
    """
    from serp.tasks.registry import find_domain_file, find_task

    task = asked_own_task()
    if domain is None:
        return task
    if task is None:
        return find_task(domain)
    file = find_domain_file(domain)
    if file is None:
        raise SerpError(f"--domain {domain}: beside --task it is a domain file")
    return dataclasses.replace(task, domain=file, problem=None)


def asked_domain(name: str | None, problem: Path | None = None) -> tuple[Domain, Task | None]:
    """Return a domain and the task that it belongs to, with that domain; None for no task.

    `name` is a domain file, or that of an installed task, for which the task of `--task` stands.
    The problem is by default the one that belongs to the domain.
    """
    from serp.model.domain import load_domain
    from serp.tasks.registry import find_domain_file, load_task, task_of

    own = asked_own_task()
    if not name and own is None:
        raise click.UsageError("give --domain (`serp list` names the tasks) or --task")
    file = find_domain_file(name) if name else None
    if file is None:
        task = own or load_task(str(name))
        domain = task.load()
        if problem is not None:
            domain = load_domain(domain.source.name, problem, observed=not task.closed)
        return domain, _with_domain(task, domain)
    domain = load_domain(file, problem)
    belonging = task_of(domain, file) if own is None else _with_domain(own, domain)
    return domain if belonging is None else belonging.load(), belonging


def _with_domain(task: Task, domain: Domain) -> Task:
    return dataclasses.replace(task, domain=domain, problem=None)


def open_run(folder: Path) -> Run:
    """Open a run, and print the notice of its agent, if it has one."""
    from serp.runs.run import load_run

    run = load_run(folder, asked_own_task())
    if run.notice is not None:
        say(run.notice)
    return run


def rolled_out(
    bound: BoundTask, planner: ChosenPlanner | MonitorReplanner, seed: int
) -> Iterator[tuple[Vector, Plan, bool]]:
    """Let a planner act in an environment, without end; yield each state, plan, and episode's end.

    The plan of a state at the end is not carried out.
    """
    (raw, info), over = bound.reset(seed), False
    while True:
        state = bound.ground(raw, info, bound.env)
        plan = planner.plan(state)
        over = over or plan.action is None
        yield state, plan, over
        if over or plan.action is None:
            (raw, info), over = bound.reset(), False
            continue
        action = bound.actions.environment_action[plan.action]
        raw, _, terminated, truncated, info = bound.step(action)
        over = terminated or truncated


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
    nothing else is known, from the environment of the task after a reset with `seed`: the first
    state in which the planner has a choice or, with assignments, the one after the reset.
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
        if task is None:
            raise SerpError(
                f"--observe: no task is installed for domain `{domain.name}`, so there is no "
                "environment to observe; give the state with --state"
            )
        with _with_domain(task, domain).bind() as bound:
            # The grounding says what of :init is observed.
            grounded = domain if problem is None else bound.domain
            origin, deadline = f"observed after a reset with seed {seed}", time.monotonic() + 10.0
            played = rolled_out(bound, make_planner(grounded), seed)
            state = None
            for steps, (reached, plan, _) in enumerate(itertools.islice(played, 200)):
                state = reached if state is None else state
                if given or time.monotonic() > deadline:
                    break
                if plan.forecast.applicable.sum() > 1 and not plan.indifferent:
                    origin += f" and {plural(steps, 'step')} without a choice" if steps else ""
                    state = reached
                    break
            assert state is not None
        base = grounded.model.values(state)
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


def parse_state(
    assignments: Iterable[str], domain: Domain, option: str = "--state"
) -> dict[str, float]:
    """Return fluent → value of `fluent=value` texts, several in one text separated by commas.

    A predicate takes `true` or `false` as well as 1 or 0. `option` begins the messages.
    """
    state: dict[str, float] = {}
    for text in (part for whole in assignments for part in whole.split(",") if part.strip()):
        target, equals, value = text.partition("=")
        if not equals or not target.strip():
            raise click.UsageError(
                f"{option} {text}: expected fluent=value, such as pole-angle=0.05"
            )
        name = " ".join(target.lower().strip().strip("()").split())
        declaration = domain.declared(name)
        if declaration is None:
            model = domain.model
            known = [*(fluent.name for fluent in model.fluents), *model.ground.static]
            raise SerpError(f"{option}: unknown fluent `{name}`; {did_you_mean(name, known)}")
        if name in state:
            raise SerpError(f"{option}: `{name}` is given twice")
        state[name] = _value(name, value.strip(), option, numeric=declaration.numeric)
    return state


def _value(name: str, text: str, option: str, *, numeric: bool) -> float:
    words = {} if numeric else {"true": 1.0, "false": 0.0}
    try:
        value = words[text.lower()] if text.lower() in words else float(text.replace("−", "-"))
    except ValueError:
        value = float("nan")
    if value - value != 0.0 or (not numeric and value not in (0.0, 1.0)):
        wanted = "a finite number" if numeric else "true or false"
        raise SerpError(f"{option}: `{name}` is {wanted}, not `{text}`")
    return value
