"""What `serp studio` is asked to open: a domain file, or the name of an installed task."""

from __future__ import annotations

from pathlib import Path

from serp.errors import SerpError
from serp.model.loading import Domain, problem_beside
from serp.pddl.source import Source
from serp.settings import Settings, resolve
from serp.studio.document import Document
from serp.studio.reading import Surroundings
from serp.studio.session import Session
from serp.tasks.registry import find_domain_file, load_task, task_entries, task_of
from serp.tasks.task import Task


def open_session(
    name: str, folder: Path, own: Task | None = None, own_name: str | None = None
) -> Session:
    """Open a domain file, with the problem beside it and the task that it belongs to.

    Args:
        name: A domain file, or the name of an installed task.
        folder: The working folder.
        own: The task of `--task`.
        own_name: What `--task` says.

    Raises:
        SerpError: There is no such file or task.
    """
    file = find_domain_file(name)
    task = own
    if file is None:
        task = own or load_task(name)
        if isinstance(task.domain, Domain):
            file = Path(task.domain.source.name)
        else:
            file = Path(task.domain)
    if not file.is_file():
        raise SerpError(f"{file}: there is no such file")
    problem = problem_beside(file)
    if task is not None and task.problem is not None:
        problem = Path(task.problem)
    documents = Document(file, folder), Document(problem, folder) if problem.is_file() else None
    task = task or _task_of(file)
    return Session(folder, *documents, _surroundings(task), task, own_name)


def _task_of(file: Path) -> Task | None:
    """Return the installed task of a file, which may be wrong; None where there is none."""
    try:
        domain = Domain.parse(Source.read(file))
    except SerpError:
        return load_task(file.stem) if file.stem in task_entries() else None
    return task_of(domain, file)


def _surroundings(task: Task | None) -> Surroundings:
    if task is None:
        return Surroundings(planner=Settings().planner)
    return Surroundings(
        dt=float(task.dt),
        planner=resolve("default", task.settings).planner,
        observed=not task.closed,
    )
