"""The texts of a new task's files, and writing them where nothing is overwritten."""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import itertools
import math
import os
import re
import sys
import traceback
import unicodedata
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import EnumMeta
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from serp._util.files import write_together
from serp._util.numbers import real
from serp._util.text import plural
from serp.errors import TaskError
from serp.pddl.scope import RESERVED_WORDS
from serp.tasks.environment import ActionSpace, Observations
from serp.tasks.registry import attribute_of, import_file, task_like

_RESERVED: Final = RESERVED_WORDS | {"reward", "unsafe", "terminal", "over", "at-start", "at-end"}
_LONGEST: Final = 40
_ASIDE: Final = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|`")
_MINUS: Final = re.compile(r"(?<![\w.])[-−](?=\d)")


class Names:
    """Makes names of PDDL of any texts; no name is given twice."""

    def __init__(self) -> None:
        self._given: set[str] = set()

    def make(self, text: str, otherwise: str) -> str:
        """Return a name that says what a text says; `otherwise` where the text has no letters.

        What stands in brackets is left out, and all but the first sentence.
        """
        plain = unicodedata.normalize("NFKD", _ASIDE.sub("", text)).encode("ascii", "ignore")
        words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", _MINUS.sub("minus ", plain.decode()))
        words = re.split(r"[.;:,](?:\s|$)", words.strip())[0].lower().replace("'", "")
        name = "-".join(re.findall(r"[a-z0-9]+", words))
        while len(name) > _LONGEST and "-" in name:
            name = name.rpartition("-")[0]
        name = name[:_LONGEST].strip("-")
        if not re.search("[a-z]", name):
            name = "-".join(re.findall(r"[a-z0-9]+", otherwise.lower())) or "entry"
        if not name[0].isalpha() or name in _RESERVED:
            name = f"the-{name}"
        unique, number = name, 1
        while unique in self._given:
            number += 1
            unique = f"{name}-{number}"
        self._given.add(unique)
        return unique


def remark(text: str) -> str:
    """Return a text for a comment of one line: no line breaks, control characters and quotes."""
    kept = (c if c.isprintable() and c not in '"\\' else " " for c in text)
    return " ".join("".join(kept).split())[:100]


_HEADING: Final = re.compile(r"^\s*#+\s*(.+?)\s*$", re.M)
_ITEM: Final = re.compile(r"^\s*(?:[-*+]\s+)?(\d+)\s*[:=.)]\s+(\S.*?)\s*$")
_ROW: Final = re.compile(r"^\s*\|\s*(\d+)\s*\|\s*([^|]*?)\s*\|")


def numbered(documentation: str, heading: str, count: int) -> list[str] | None:
    """Return what stands beside the numbers 0 ... count-1 under a heading.

    None where there is no such list or table. Of several lists the first counts.
    """
    found: dict[int, str] = {}
    for line in _under(documentation, heading).splitlines():
        match = _ROW.match(line) or _ITEM.match(line)
        if match and int(match[1]) == len(found) and match[2]:
            found[int(match[1])] = match[2]
        elif match and int(match[1]) == 0:
            break  # another list
    return [found[k] for k in range(count)] if len(found) == count else None


def _under(documentation: str, heading: str) -> str:
    """Return the text from one heading to the next."""
    headings = list(_HEADING.finditer(documentation))
    for k, match in enumerate(headings):
        if match[1].strip("* ").lower() == heading.lower():
            end = headings[k + 1].start() if k + 1 < len(headings) else len(documentation)
            return documentation[match.end() : end]
    return ""


MOST: Final = 64
"""Most actions, and most numbers of an observation, that a file is filled in with."""


@dataclass(frozen=True)
class Listed:
    """An action or a number of an observation.

    Attributes:
        name: Its name in the domain file.
        value: The environment action, or the expression of the observation's number, in Python.
        comment: One line: what the environment says of it.
    """

    name: str
    value: str
    comment: str


@dataclass(frozen=True)
class Described:
    """An environment, as far as it tells.

    Attributes:
        actions: Its actions, in their order.
        numbers: The numbers of an observation, in their order.
        dt: Seconds of a step; None where it does not say.
    """

    actions: tuple[Listed, ...]
    numbers: tuple[Listed, ...]
    dt: float | None


def describe(env: gym.Env[Any, Any], called: str) -> Described:
    """Return what an environment tells of itself.

    Args:
        env: The environment.
        called: What it is called in messages.

    Raises:
        TaskError: Its actions are not discrete, its observations are no numbers, or there are too
            many of either.
    """
    try:
        actions, observations = ActionSpace(env.action_space), Observations(env.observation_space)
    except ValueError as error:
        raise TaskError(
            f"{called}: {error}; what has to be changed can be wrapped around it in a function of "
            "your own, which --env FILE.py:FUNCTION names"
        ) from None
    if actions.size > MOST:
        raise TaskError(
            f"{called} has {actions.size:,} actions, more than a file can say something of; offer "
            f"those that make sense, {MOST} at most, through gymnasium.wrappers.TransformAction"
        )
    if observations.size == 0:
        raise TaskError(f"{called}: an observation has no numbers")
    numbers = list(_numbers(env.observation_space, "observation", "observation"))
    if len(numbers) > MOST:
        count = math.prod(env.observation_space.shape or (len(numbers),))
        raise TaskError(
            f"an observation of {called} has {plural(count, 'number')}, too many to be "
            "fluents one by one; say the few that matter through "
            "gymnasium.wrappers.TransformObservation, or write the task yourself "
            "(how-to: Connect your own environment)"
        )
    names = Names()
    texts = numbered(_documentation(env), "Observation Space", len(numbers))
    fields = tuple(
        _entry(names, texts[k] if texts else "", name, expression, bounds)
        for k, (name, expression, bounds) in enumerate(numbers)
    )
    return Described(_actions(env, actions), fields, _period(env))


def _entry(names: Names, text: str, otherwise: str, value: str, bounds: str = "") -> Listed:
    """Return an entry; what its name says already is left out of the comment."""
    name = names.make(text or otherwise, otherwise)
    said = "" if re.findall(r"\w+", text.lower()) == name.split("-") else remark(text)
    return Listed(name, value, ", ".join(filter(None, (said, bounds))))


# Actions -----------------------------------------------------------------------------------------


def _actions(env: gym.Env[Any, Any], space: ActionSpace) -> tuple[Listed, ...]:
    names = Names()
    texts = _told(env, space.size)
    texts = texts or numbered(_documentation(env), "Action Space", space.size)
    entries = []
    for k in range(space.size):
        action = space.action(k)
        value, otherwise = str(k), f"action-{k}"
        if isinstance(action, np.ndarray):
            value = repr(tuple((action - getattr(space.space, "start", 0)).ravel().tolist()))
            otherwise = f"action-{'-'.join(map(str, action.ravel().tolist()))}"
        entries.append(_entry(names, texts[k] if texts else "", otherwise, value))
    return tuple(entries)


def _told(env: gym.Env[Any, Any], count: int) -> list[str] | None:
    """Return the names that an environment has for its actions; None where it has none.

    The outermost wrapper that has names is asked. They are what `get_action_meanings()` returns, as
    environments of Atari games have it, or an attribute of the environment, or of its attributes,
    whose name speaks of actions: an enumeration of all actions, a list of their names, or a mapping
    from numbers to names.
    """
    layer: Any = env
    while (found := _told_by(layer, count)) is None and isinstance(layer, gym.Wrapper):
        layer = layer.env
    return found


def _told_by(layer: Any, count: int) -> list[str] | None:
    """Return the names that an environment has, or one of its wrappers, without what is inside."""
    meanings = getattr(layer, "get_action_meanings", None)
    if callable(meanings):
        try:
            if found := _names_in(meanings(), count):
                return found
        except Exception:  # it is the environment's, and only asked for help
            pass
    for value in _speaking_of_actions(layer):
        if found := _names_in(value, count):
            return found
        if not isinstance(value, spaces.Space) and hasattr(value, "__dict__"):
            for part in _speaking_of_actions(value):
                if found := _names_in(part, count):
                    return found
    return None


def _speaking_of_actions(thing: Any) -> Iterator[Any]:
    """Yield the attributes whose names speak of actions, without running any code of theirs."""
    known = {**dict(inspect.getmembers_static(type(thing))), **getattr(thing, "__dict__", {})}
    for name in sorted(known):
        if "action" in name.lower() and not isinstance(known[name], property):
            yield known[name]


def _names_in(value: Any, count: int) -> list[str] | None:
    if isinstance(value, EnumMeta):
        members: Mapping[str, Any] = value.__members__
        value = {member.value: name for name, member in members.items()}
    if isinstance(value, Mapping):
        if set(value) != set(range(count)):
            return None
        value = [value[k] for k in range(count)]
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != count:
        return None
    if not all(isinstance(text, str) for text in value):
        return None
    return [text.replace("_", " ").lower() for text in value]


# Observations ------------------------------------------------------------------------------------


def _numbers(space: Any, expression: str, name: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, expression in Python, and bounds of each number of an observation."""
    if isinstance(space, spaces.Dict):
        for key, part in space.spaces.items():
            if not isinstance(key, str):
                raise TaskError(f"the observation has a part {key!r}; name its parts by texts")
            inner = str(key) if name == "observation" else f"{name} {key}"
            yield from _numbers(part, f"{expression}[{key!r}]", inner)
    elif isinstance(space, spaces.Tuple):
        for k, part in enumerate(space.spaces):
            yield from _numbers(part, f"{expression}[{k}]", f"{name}-{k}")
    elif isinstance(space, spaces.Discrete):
        first, last = int(space.start), int(space.start + space.n - 1)
        yield name, expression, f"{first} to {last}"
    elif not isinstance(space, spaces.Text):
        shape = tuple(space.shape or ())
        for place in itertools.islice(itertools.product(*map(range, shape)), 10 * MOST):
            at = f"[{', '.join(map(str, place))}]" if place else ""
            entry = "-".join([name, *map(str, place)])
            yield entry, f"{expression}{at}", _bounds(space, place)


def _bounds(space: Any, place: tuple[int, ...]) -> str:
    if isinstance(space, spaces.Box):
        low, high = float(space.low[place]), float(space.high[place])
    elif isinstance(space, spaces.MultiDiscrete):
        first = int(np.asarray(space.start)[place])
        low, high = first, first + int(np.asarray(space.nvec)[place]) - 1
    else:
        low, high = 0, 1
    if np.isinf(low) and np.isinf(high):
        return "unbounded"
    return f"{low:.4g} to {high:.4g}"


def _documentation(env: gym.Env[Any, Any]) -> str:
    return inspect.getdoc(type(env.unwrapped)) or ""


def _period(env: gym.Env[Any, Any]) -> float | None:
    try:
        found = real(getattr(env.unwrapped, "dt", None))
    except Exception:  # a property of the environment
        return None
    return float(found) if found is not None and found > 0 else None


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


_NAME: Final = re.compile(r"[a-z][a-z0-9_-]*")


def new_task(path: Path, env: str | None = None) -> list[Path]:
    """Write the first files of a task; return them.

    Args:
        path: Folder and name of the task.
        env: The environment. None: an example whose world is the file itself.

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
