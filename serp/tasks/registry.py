"""Tasks by name: installed packages declare them as entry points of the group `serp.tasks`."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeGuard, cast

from serp._util import plugins
from serp._util.did_you_mean import did_you_mean
from serp.errors import SerpError, TaskError
from serp.model.domain import Domain, load_domain

if TYPE_CHECKING:
    from serp.tasks.task import Task

GROUP = "serp.tasks"


def custom_task(name: str) -> Task:
    """Return the task that `--task` names.

    The name refers to a `serp.Task`, or to a function without arguments that returns one; a file
    with one task needs no function name. Installed modules come before those in the working
    directory; importing a module runs it.

    Raises:
        TaskError: There is no such file, module or function, it fails, or it returns no task.
    """
    made, where = _made_task(name), name.rpartition(":")[0] if ".py:" in name else name
    if not where.endswith(".py"):
        return made
    return dataclasses.replace(made, code=f"{Path(where).resolve()}{name[len(where) :]}")


def _made_task(name: str) -> Task:
    option = f"--task {name}"
    module, attribute = _named(name, option, "FILE.py, FILE.py:FUNCTION or MODULE:FUNCTION")
    value = attribute_of(module, attribute, option) if attribute else _only(module, name)
    if _is_task(value):
        return value
    if not callable(value):
        raise TaskError(f"{option}: `{attribute}` is a {type(value).__name__}, not a serp.Task")
    try:
        made = value()
    except SerpError:
        raise
    except Exception as error:
        from serp.tasks.task import Task

        wrong = re.search(r"Task.*unexpected keyword argument '(\w+)'", str(error))
        meant = f"; {did_you_mean(wrong[1], Task.__dataclass_fields__)}" if wrong else ""
        what = f"{plugins.raised(error)}{meant}"
        raise TaskError(f"{option}: making the task failed: {what}") from error
    if not _is_task(made):
        hint = "; is a `return` missing?" if made is None else ""
        raise TaskError(f"{option}: it returned {type(made).__name__}, not a serp.Task{hint}")
    return made


def custom_function(name: str, option: str) -> Callable[..., Any]:
    """Return the function that `FILE.py:FUNCTION` or `MODULE:FUNCTION` names, or a TaskError."""
    module, attribute = _named(name, option, "FILE.py:FUNCTION or MODULE:FUNCTION")
    if not attribute:
        raise TaskError(f"{option}: name the function, {name}:FUNCTION")
    function = attribute_of(module, attribute, option)
    if not callable(function):
        raise TaskError(f"{option}: `{attribute}` is a {type(function).__name__}, not a function")
    return cast(Callable[..., Any], function)


def _named(name: str, option: str, forms: str) -> tuple[ModuleType, str]:
    """Import the module or file of a name; return it and what follows the colon."""
    where, colon, attribute = name.rpartition(":") if not name.endswith(".py") else (name, "", "")
    if not where or (colon and not attribute):
        raise TaskError(f"{option}: expected {forms}")
    if where.endswith(".py"):
        return import_file(Path(where), option), attribute
    return _import_module(where, Path(), option), attribute


def import_file(file: Path, option: str) -> ModuleType:
    """Import a file as a module of its name, so that other processes can import it, too."""
    if not file.is_file():
        raise TaskError(f"{option}: there is no such file")
    module = _import_module(file.stem, file.parent, option)
    if not module.__file__ or Path(module.__file__).resolve() != file.resolve():
        raise TaskError(
            f"{option}: another module is called `{file.stem}` ({module.__file__}); "
            "give the file another name"
        )
    return module


def _import_module(name: str, folder: Path, option: str) -> ModuleType:
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.append(place)  # last, so that no file hides an installed module
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise TaskError(f"{option}: importing it failed: {plugins.raised(error)}") from error
        raise TaskError(
            f"{option}: there is no module `{error.name}`, neither installed nor in {place}"
        ) from None
    except Exception as error:
        raise TaskError(f"{option}: importing it failed: {plugins.raised(error)}") from error


def attribute_of(module: ModuleType, attribute: str, option: str) -> Any:
    """Return what a module has under a name, which may have dots."""
    value: Any = module
    for part in attribute.split("."):
        if not hasattr(value, part):
            public = (name for name in dir(value) if not name.startswith("_"))
            names = [name for name in public if callable(getattr(value, name))]
            raise TaskError(
                f"{option}: {module.__file__} has no `{attribute}`; {did_you_mean(part, names)}"
            )
        value = getattr(value, part)
    return value


def _only(module: ModuleType, name: str) -> Any:
    """Return the only task of a file: a `serp.Task`, or a function annotated to return one."""
    tasks = {
        key: value
        for key, value in vars(module).items()
        if _is_task(value) or _makes_task(value, module)
    }
    if len(tasks) == 1:
        return next(iter(tasks.values()))
    if tasks:
        which = ", ".join(f"`--task {name}:{key}`" for key in tasks)
        raise TaskError(f"--task {name}: there are several tasks; write one of {which}")
    if own := environments_of(module):
        write = f"`serp new NAME --env {name}:{own[0]}` writes a task for `{own[0]}`"
        raise TaskError(f"--task {name}: it holds an environment, not a task; {write}")
    raise TaskError(
        f"--task {name}: it holds no serp.Task, and no function annotated `-> serp.Task`; if a "
        f"function without this annotation returns the task, write `--task {name}:FUNCTION`"
    )


def environments_of(module: ModuleType) -> list[str]:
    """Return the names of the environment classes that a module defines."""
    from gymnasium import Env

    classes = inspect.getmembers(module, inspect.isclass)
    own = [name for name, kind in classes if kind.__module__ == module.__name__]
    return [name for name in own if issubclass(getattr(module, name), Env)]


def _is_task(value: Any) -> TypeGuard[Task]:
    from serp.tasks.task import Task  # here, because the name of a file needs none

    return isinstance(value, Task)


def _makes_task(value: Any, module: ModuleType) -> bool:
    from serp.tasks.task import Task

    if not inspect.isfunction(value) or value.__module__ != module.__name__:
        return False
    return value.__annotations__.get("return") in (Task, "Task", "serp.Task")


def task_entries() -> dict[str, EntryPoint]:
    """Return the entry points of installed tasks by name, without importing them."""
    return plugins.offered(GROUP)


def load_task(name: str) -> Task:
    """Return the installed task with a name.

    Raises:
        TaskError: There is none, or making it fails.
    """
    advice = "\n  For your own task, use `--task FILE.py`, or pass a `serp.Task` in Python."
    entry = plugins.find(task_entries(), name, "task", TaskError, advice=advice)
    with plugins.loading(entry, "task", TaskError):
        made = entry.load()()
    if not _is_task(made):
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


def find_task(named: Task | str) -> Task:
    """Return the task that is given, or meant by its name or by a domain file.

    A file belongs to the task with the name of its domain, or with the name of the file up to a
    hyphen (`cartpole-no-gravity.pddl` is a variant for the task `cartpole`). One that belongs to
    none is a world (`serp.file_task`) if its problem has an `:init`.

    Raises:
        TaskError: There is no such file or task, or the file is no world to learn in.
        DomainError: The file is wrong.
    """
    if _is_task(named):
        return named
    if not isinstance(named, str):
        raise TaskError(f"a task must be a serp.Task, a name or a domain file, not {named!r}")
    path = find_domain_file(named)
    if path is None and Path(named).is_dir() and named not in task_entries():
        raise TaskError(f"{named} is a folder; give one of the files in it, or the name of a task")
    if path is None:
        return load_task(named)
    loaded = load_domain(path, observed=True)
    task = task_of(loaded, path)
    if task is not None:
        return task
    if loaded.problem_syntax is None or not loaded.problem_syntax.has_init:
        raise TaskError(
            f"{path}: no task is installed for domain `{loaded.name}` "
            f"({did_you_mean(loaded.name, task_entries()) or 'none is installed'}). If you have an "
            "environment, write a serp.Task (as `serp new` does) and give --task FILE.py:FUNCTION. "
            "If not, add a problem file with an `:init` to train in the file's world"
        )
    from serp.tasks.file_world import file_task

    world = load_domain(path)
    if not world.model.rewarding:
        raise TaskError(
            f"{path} says nothing about reward, so there is nothing to learn in its world; write "
            "`(increase (reward) ...)` in an action or event, or a :goal in the problem"
        )
    return file_task(world)


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
    if name is None:
        return None
    return dataclasses.replace(load_task(name), domain=domain, problem=None)


def task_like(*names: str) -> str | None:
    """Return the first installed task with one of these names, or with one up to a hyphen."""
    entries = task_entries()
    shortened = (short for name in names for short in _shortened(name))
    return next((name for name in (*names, *shortened) if name in entries), None)


def _shortened(name: str) -> list[str]:
    parts = name.split("-")
    return ["-".join(parts[:k]) for k in range(len(parts) - 1, 0, -1)]
