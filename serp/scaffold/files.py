"""The texts of a new task's files, and writing them where nothing is overwritten."""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any, Final

from serp._util.files import write_together
from serp.errors import TaskError
from serp.scaffold.environment import Described, Listed, describe
from serp.scaffold.made_env import MadeEnvironment, made
from serp.scaffold.names import remark
from serp.tasks.registry import task_like

_NAME: Final = re.compile(r"[a-z][a-z0-9_-]*")


def new_task(path: Path, env: str | None = None) -> list[Path]:
    """Write the first files of a task; return them.

    Args:
        path: Folder and name of the task.
        env: The environment, see `serp.scaffold.made_env`. None: an example whose world is the file
            itself.

    Raises:
        TaskError: The name does not do, a file exists, or the environment does not.
    """
    _check_name(path)
    if env is None:
        texts = _world_texts(path.name)
    else:
        _refuse_existing(path, [f"{path.name}.{kind}" for kind in ("pddl", "py")])
        if importlib.util.find_spec(path.name) is not None:
            raise TaskError(f"{path.name}: a Python module has this name; choose another one")
        with made(env) as found:
            texts = _environment_texts(path.name, env, found, describe(found.env, f"--env {env}"))
    _refuse_existing(path, texts)
    files = {path.with_name(name): text for name, text in texts.items()}
    write_together(files)
    return list(files)


def _check_name(path: Path) -> None:
    name = path.name
    if not _NAME.fullmatch(name):
        raise TaskError(
            f"{path}: a task's name begins with a letter and goes on with small letters, digits, "
            "`-` and `_`, such as delivery-robot"
        )
    if not path.parent.is_dir():
        raise TaskError(f"{path}: there is no folder {path.parent}")
    like = task_like(name)
    if like is not None:
        raise TaskError(
            f"{name}: `{like}` is an installed task, and a file of this name would belong to it; "
            "choose another name"
        )


def _refuse_existing(path: Path, names: Mapping[str, str] | list[str]) -> None:
    there = [str(path.with_name(name)) for name in names if os.path.lexists(path.with_name(name))]
    if there:
        raise TaskError(f"{' and '.join(there)}: there is such a file already; nothing is written")


def _world_texts(name: str) -> dict[str, str]:
    return {
        f"{name}.pddl": _filled("world.pddl", name=name),
        f"{name}-problem.pddl": _filled("world-problem.pddl", name=name),
        f"{name}.scenarios": _filled("world.scenarios", name=name),
    }


def _environment_texts(
    name: str, env: str, how: MadeEnvironment, told: Described
) -> dict[str, str]:
    """Return file → text. Whatever the environment says stands in comments and quotes only."""
    width = max(7, *(len(entry.name) for entry in told.numbers))
    functions = [f"    ({e.name}){_after(e, width - len(e.name))}" for e in told.numbers]
    functions.append(
        f"    (reward)){' ' * (width - 7)}  ; reserved: its gain is the reward of a step"
    )
    domain = _filled(
        "environment.pddl",
        name=name,
        env=remark(env),
        first=told.numbers[0].name,
        functions="\n".join(functions),
        actions="\n".join(map(_action, told.actions)),
    )
    adapter = _filled(
        "adapter.txt",
        name=name,
        env=remark(env),
        imports=how.imports,
        parameters=how.parameters,
        expression=how.expression,
        fields="\n".join(f'        "{e.name}": {e.value},' for e in told.numbers),
        actions="\n".join(f'            "{e.name}": {e.value},' for e in told.actions),
        dt=told.dt or 1.0,
    )
    scenarios = _filled(
        "environment.scenarios", name=name, first=told.numbers[0].name, action=told.actions[0].name
    )
    return {f"{name}.pddl": domain, f"{name}.py": adapter, f"{name}.scenarios": scenarios}


def _action(entry: Listed) -> str:
    return (
        f"  (:action {entry.name}{_after(entry, 0)}\n"
        "    :parameters ()\n    :precondition (and)\n    :effect (and))\n"
    )


def _after(entry: Listed, blanks: int) -> str:
    return f"{' ' * blanks}  ; {entry.comment}" if entry.comment else ""


def _filled(template: str, **values: Any) -> str:
    text = resources.files(__package__).joinpath("templates", template).read_text("utf-8")
    return Template(text).substitute(values)
