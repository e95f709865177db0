"""The domain, task or run that a command is asked for, loaded."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from serp.errors import SerpError
from serp.ui.main import say
from serp.ui.options import own_task_name

if TYPE_CHECKING:
    from serp.model.domain import Domain
    from serp.runs.run import Run
    from serp.tasks.task import Task


def asked_own_task() -> Task | None:
    """Return the task that `--task` names, or None where it is not given."""
    name = own_task_name()
    if name is None:
        return None
    from serp.tasks.registry import custom_task

    return custom_task(name)


def asked_task(
    domain: str | None, max_ground_schemas: int | None = None, *, worlds: bool = False
) -> Task | None:
    """Return the task that `--task` and `--domain` mean together; None where neither is given.

    `--domain` is an installed task or a domain file; beside `--task`, another domain file for it.
    `worlds` is that of `serp.tasks.registry.find_task`.
    """
    from serp.tasks.registry import find_domain_file, find_task

    task = asked_own_task()
    if task is None:
        if domain is None:
            return None
        task = find_task(domain, max_ground_schemas, worlds=worlds)
    elif domain is not None:
        file = find_domain_file(domain)
        if file is None:
            raise SerpError(f"--domain {domain}: beside --task it is a domain file")
        task = dataclasses.replace(task, domain=file, problem=None)
    if max_ground_schemas is None:
        return task
    return with_domain(task, domain_of(task, None, max_ground_schemas))


def asked_domain(
    name: str,
    file: Path | None,
    problem: Path | None,
    max_ground_schemas: int | None,
    own: Task | None,
) -> tuple[Domain, Task | None]:
    """Return a domain and the task that it belongs to, with that domain; None for no task.

    `name` is that of an installed task; it counts where there is neither a domain file nor the task
    of `--task`. The problem is by default the one that belongs to the domain.
    """
    from serp.model.domain import load_domain
    from serp.tasks.registry import load_task, task_of

    if file is None:
        task = own or load_task(name)
        domain = domain_of(task, problem, max_ground_schemas)
        return domain, with_domain(task, domain)
    domain = load_domain(file, problem, max_ground_schemas=max_ground_schemas)
    found = task_of(domain, file) if own is None else with_domain(own, domain)
    return domain if found is None else found.load(), found


def domain_of(task: Task, problem: Path | None, max_ground_schemas: int | None) -> Domain:
    """Return the domain of a task, with another problem file or limit if these are given."""
    from serp.model.domain import Domain, load_domain

    if problem is None and max_ground_schemas is None:
        return task.load()
    file, limit = task.domain, max_ground_schemas
    if isinstance(file, Domain):
        if problem is None and limit is not None:
            return dataclasses.replace(task.load(), max_ground_schemas=limit)
        file = file.source.name
    return load_domain(
        file, problem or task.problem, observed=not task.closed, max_ground_schemas=limit
    )


def with_domain(task: Task, domain: Domain) -> Task:
    """Return a task with a domain that is loaded, problem and all."""
    return dataclasses.replace(task, domain=domain, problem=None)


def open_run(folder: Path) -> Run:
    """Open a run, and print the notice of its agent, if it has one."""
    from serp.runs.run import load_run

    run = load_run(folder, asked_own_task())
    if run.notice is not None:
        say(run.notice)
    return run
