"""The option `--task`: a task of one's own, wherever `--domain` or a run stands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.errors import SerpError

if TYPE_CHECKING:
    from serp.model.loading import Domain
    from serp.tasks.task import Task

_KEY = f"{__name__}.task"


def _remember(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
    ctx.meta[_KEY] = value


own_task_option = click.option(
    "--task", metavar="FILE.py|MODULE:FUNCTION", expose_value=False, callback=_remember,
    help="A task that is not installed: a Python file, FILE.py:FUNCTION or MODULE:FUNCTION that "
         "gives a serp.Task.")  # fmt: skip


def own_task_name() -> str | None:
    """Return what `--task` says, or None where it is not given."""
    name: str | None = click.get_current_context().meta.get(_KEY)
    return name


def asked_own_task() -> Task | None:
    """Return the task that `--task` names, or None where it is not given.

    Raises:
        TaskError: There is no such task.
    """
    name = own_task_name()
    if name is None:
        return None
    from serp.tasks.custom_tasks import custom_task

    return custom_task(name)


def asked_task(domain: str | None) -> Task | None:
    """Return the task that `--task` and `--domain` mean together; None where neither is given.

    Beside `--task`, `--domain` is another domain file for it.

    Raises:
        SerpError: There is no such task or file.
    """
    import dataclasses

    from serp.tasks.registry import find_domain_file, find_task

    task = asked_own_task()
    if domain is None or task is None:
        return find_task(domain) if domain is not None else task
    file = find_domain_file(domain)
    if file is None:
        raise SerpError(f"--domain {domain}: beside --task it is a domain file")
    return dataclasses.replace(task, domain=file, problem=None)


def limited(task: Task, max_ground_schemas: int | None) -> Task:
    """Return a task whose domain may be so large; None for the usual limit.

    Raises:
        DomainError: A file is wrong, or the domain too large.
    """
    import dataclasses

    if max_ground_schemas is None:
        return task
    domain = domain_of(task, None, max_ground_schemas)
    return dataclasses.replace(task, domain=domain, problem=None)


def domain_of(task: Task, problem: Path | None, max_ground_schemas: int | None) -> Domain:
    """Return the domain of a task.

    Args:
        task: The task.
        problem: The problem file; None for the task's own.
        max_ground_schemas: How large the domain may be; None for the usual limit.

    Raises:
        DomainError: A file is wrong, or the domain too large.
    """
    import dataclasses

    from serp.model.loading import Domain, load_domain

    if problem is None and max_ground_schemas is None:
        return task.load()
    file, limit = task.domain, max_ground_schemas
    if isinstance(file, Domain):
        if problem is None and limit is not None:
            return dataclasses.replace(file.observed(), max_ground_schemas=limit)
        file = file.source.name
    return load_domain(file, problem or task.problem, observed=True, max_ground_schemas=limit)
