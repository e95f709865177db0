"""Tasks by name: installed packages declare them as entry points of the group `serp.tasks`."""

from __future__ import annotations

import dataclasses
from importlib.metadata import EntryPoint
from pathlib import Path

from serp._util import plugins
from serp._util.text import did_you_mean
from serp.errors import TaskError
from serp.model.loading import Domain, load_domain
from serp.tasks.task import Task

GROUP = "serp.tasks"


def task_entries() -> dict[str, EntryPoint]:
    """Return the entry points of installed tasks by name, without importing them."""
    return plugins.offered(GROUP)


def load_task(name: str) -> Task:
    """Return the installed task with a name.

    Raises:
        TaskError: There is none, or making it fails.
    """
    advice = "\n  one of your own: --task FILE.py:FUNCTION, or in Python the serp.Task itself"
    entry = plugins.find(task_entries(), name, "task", TaskError, advice=advice)
    with plugins.loading(entry, "task", TaskError):
        made = entry.load()()
    if not isinstance(made, Task):
        raise TaskError(f"`{entry.value}` returned {type(made).__name__}, not a serp.Task")
    return made


def find_domain_file(domain: str) -> Path | None:
    """Return the file that `--domain` means; None for the name of an installed task.

    It is a path, also of a file that is no PDDL, or `domains/NAME.pddl` or `NAME.pddl` in the
    working directory, or a variant `NAME.pddl` beside the domain file of an installed task.
    """
    path = Path(domain)
    if path.suffix == ".pddl" or len(path.parts) > 1 or (path.suffix and path.is_file()):
        return path  # loading it reports what is wrong with it
    for candidate in (Path("domains") / f"{domain}.pddl", Path(f"{domain}.pddl")):
        if candidate.is_file():
            return candidate
    return None if domain in task_entries() else _shipped_beside(domain)


def find_task(domain: str, max_ground_schemas: int | None = None, *, worlds: bool = False) -> Task:
    """Return the task that `--domain` means: the name of an installed task, or a domain file.

    A file belongs to the task with the name of its domain, or with the name of the file up to a
    hyphen (`cartpole-no-gravity.pddl` is a variant for the task `cartpole`). With `worlds`, one
    that belongs to none is a world, as in `serp play` (`serp.file_task`).

    Raises:
        TaskError: There is no such file, or no task for it.
        DomainError: The file is wrong.
    """
    path = find_domain_file(domain)
    if path is None and Path(domain).is_dir() and domain not in task_entries():
        raise TaskError(f"{domain} is a folder; give one of the files in it, or the name of a task")
    if path is None:
        return load_task(domain)
    loaded = load_domain(path, observed=True, max_ground_schemas=max_ground_schemas)
    task = task_of(loaded, path)
    if task is None and worlds:
        from serp.tasks.worlds.file_world import file_task

        return file_task(load_domain(path, max_ground_schemas=max_ground_schemas))
    if task is None:
        raise TaskError(
            f"{path}: no task is installed for domain `{loaded.name}` "
            f"({did_you_mean(loaded.name, task_entries()) or 'none is installed'}); with an "
            "environment of your own, write a serp.Task (serp new does) and name it: --task "
            f"FILE.py:FUNCTION; without one, the file is a world: serp play {path} --train"
        )
    return task


def _shipped_beside(name: str) -> Path | None:
    """Return the file of that name beside the domain file of an installed task; None for none."""
    entries = task_entries()
    for task in _shortened(name):
        if task in entries:
            own = load_task(task).domain
            if isinstance(own, str | Path):
                path = Path(own).with_name(f"{name}.pddl")
                return path if path.is_file() else None
    return None


def task_of(domain: Domain, path: Path) -> Task | None:
    """Return the installed task that a domain file belongs to, with that domain; None for none."""
    name = task_like(domain.name, path.stem)
    return (
        None if name is None else dataclasses.replace(load_task(name), domain=domain, problem=None)
    )


def task_like(*names: str) -> str | None:
    """Return the first installed task with one of these names, or with one up to a hyphen."""
    entries = task_entries()
    shortened = (short for name in names for short in _shortened(name))
    return next((name for name in (*names, *shortened) if name in entries), None)


def _shortened(name: str) -> list[str]:
    parts = name.split("-")
    return ["-".join(parts[:k]) for k in range(len(parts) - 1, 0, -1)]
