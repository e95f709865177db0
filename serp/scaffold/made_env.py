"""The environment that `serp new --env` names: a Gymnasium ID, or a class of one's own."""

from __future__ import annotations

import contextlib
import inspect
import sys
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from serp.errors import TaskError
from serp.tasks.custom_tasks import attribute_of, import_file


@dataclass(frozen=True)
class MadeEnvironment:
    """An environment, and how Python makes it.

    Attributes:
        env: The environment.
        imports: The line that imports what makes it.
        parameters: The parameters of the function `make_env`.
        expression: The expression that makes it.
    """

    env: gym.Env[Any, Any]
    imports: str
    parameters: str
    expression: str


@contextlib.contextmanager
def made(name: str) -> Iterator[MadeEnvironment]:
    """Yield the environment of a name, and close it at the end.

    Args:
        name: `FILE.py:NAME`, a class or a function without required arguments; else an ID for
            `gymnasium.make`, such as `CartPole-v1` or `highway_env:highway-fast-v0`.

    Raises:
        TaskError: There is no such environment, or making it fails.
    """
    file, colon, attribute = name.partition(".py:")
    found = _own(name, Path(f"{file}.py"), attribute) if colon else _registered(name)
    try:
        yield found
    finally:
        with contextlib.suppress(Exception):
            found.env.close()


def _registered(name: str) -> MadeEnvironment:
    if str(Path().resolve()) not in sys.path:
        sys.path.append(str(Path().resolve()))  # for `module:ID`
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of newer versions, and of bounds
            env = gym.make(name)
    except Exception as error:
        advice = ""
        if isinstance(error, gym.error.UnregisteredEnv):
            advice = (
                "; an ID that a package registers is written with that package, such as "
                "highway_env:highway-fast-v0, and an environment of your own FILE.py:CLASS"
            )
        raise TaskError(f"--env {name}: {_raised(error)}{advice}") from error
    return MadeEnvironment(
        env, "import gymnasium\n", "**options: Any", f"gymnasium.make({name!r}, **options)"
    )


def _raised(error: Exception) -> str:
    """Return what an exception of the environment says; where it is silent, where it arose."""
    kind = type(error).__name__
    if text := str(error):
        return f"{kind}: {text}"
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{kind} in {last.filename}:{last.lineno}: {last.line}"


def _own(name: str, file: Path, attribute: str) -> MadeEnvironment:
    if not (file.stem.isidentifier() and attribute.isidentifier()):
        raise TaskError(
            f"--env {name}: give file and class names of letters, digits and underscores"
        )
    if file.parent != Path():
        raise TaskError(f"--env {name}: call this in the folder of {file.name}")
    said = f"--env {name}"
    make = attribute_of(import_file(file, said), attribute, said)
    try:
        env = make()
    except Exception as error:
        raise TaskError(f"{said}: making it failed: {_raised(error)}") from error
    if not isinstance(env, gym.Env):
        raise TaskError(f"{said}: it made a {type(env).__name__}, not a gymnasium.Env")
    drawn = "render_mode" in inspect.signature(make).parameters
    return MadeEnvironment(
        env,
        f"from {file.stem} import {attribute}\n",
        "**options: Any" if drawn else "",
        f"{attribute}(**options)" if drawn else f"{attribute}()",
    )
