"""`serp new`: the first files of a task, from what its environment says of itself."""

from __future__ import annotations

import contextlib
import functools
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
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum, EnumMeta
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any, Final, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from serp._util.did_you_mean import listed
from serp._util.files import write_together
from serp._util.numbers import real
from serp.errors import TaskError
from serp.pddl.scope import RESERVED_WORDS
from serp.tasks.environment import takes
from serp.tasks.registry import attribute_of, environments_of, import_file, task_like
from serp.tasks.spaces import ActionSpace, Observations, is_text

MOST: Final = 64
"""Most actions, and most numbers of an observation, that a file is filled in with."""
_NAME: Final = re.compile(r"[a-z][a-z0-9_-]*")
_RESERVED: Final = RESERVED_WORDS | {"reward", "unsafe", "terminal", "over", "at-start", "at-end"}
_ASIDE: Final = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|`")
_MINUS: Final = re.compile(r"(?<![\w.])[-−](?=\d)")
_HEADING: Final = re.compile(r"^\s*#+\s*\S.*$", re.M)
_ITEM: Final = re.compile(r"^\s*(?:[-*+]\s+)?(\d+)\s*[:=.)]\s+(\S.*?)\s*$")
_ROW: Final = re.compile(r"^\s*\|\s*(\d+)\s*\|\s*([^|]*?)\s*\|")


def new_task(path: Path, env: str | None = None) -> list[Path]:
    """Write the first files of a task, for an environment or, without one, of an example world.

    Raises:
        TaskError: The name does not do, a file exists, or the environment does not.
    """
    name = path.name
    if not _NAME.fullmatch(name):
        raise TaskError(
            f"{path}: `{name}` cannot be a task's name; begin with a letter, then use "
            "lower-case letters, digits, `-` and `_`, as in delivery-robot"
        )
    if not path.parent.is_dir():
        raise TaskError(f"{path}: there is no folder {path.parent}")
    if (like := task_like(name)) is not None:
        raise TaskError(
            f"{name}: `{like}` is an installed task, so a file of this name would belong to that "
            "task; choose another name"
        )
    endings = (".pddl", "-problem.pddl" if env is None else ".py", ".scenarios")
    files = [path.with_name(f"{name}{ending}") for ending in endings]
    if existing := [str(file) for file in files if os.path.lexists(file)]:
        other = f"choose another name, such as {name}-task"
        raise TaskError(f"these files exist: {', '.join(existing)}; nothing was written; {other}")
    if env is None:
        templates = ("world.pddl", "world-problem.pddl", "world.scenarios")
        texts = [_filled(template, name=name) for template in templates]
    elif importlib.util.find_spec(name) is not None:
        raise TaskError(f"{name}: a Python module has this name; choose another one")
    else:
        with _made(env) as (made, in_python):
            texts = _texts(name, env, made, in_python)
    write_together(dict(zip(files, texts, strict=True)))
    return files


# The environment ---------------------------------------------------------------------------------


@contextlib.contextmanager
def _made(name: str) -> Iterator[tuple[gym.Env[Any, Any], dict[str, str]]]:
    """Yield the environment of a name, and how Python makes it; close it at the end.

    The name is `FILE.py:NAME`, a class or a function without required arguments; else an ID for
    `gymnasium.make`, such as `CartPole-v1` or `highway_env:highway-fast-v0`.
    """
    file, colon, attribute = name.partition(".py:")
    module, _, part = name.removesuffix(".py").partition(":")
    near = Path(f"{module}.py")
    if not colon and near.is_file() and (name.endswith(".py") or part.isidentifier()):
        meant = environments_of(import_file(near, f"--env {name}")) or ["FUNCTION"]
        classes = listed(f"--env {near}:{each}" for each in meant)
        raise TaskError(f"--env {name}: name a class or a function in the file: {classes}")
    if colon:
        make = _of_file(f"--env {name}", Path(f"{file}.py"), attribute)
        imports, call = f"from {file} import {attribute}\n", f"{attribute}("
        options = "**options" if takes(make, "render_mode") else ""
    else:
        if str(Path().resolve()) not in sys.path:
            sys.path.append(str(Path().resolve()))  # for `module:ID`
        make = functools.partial(gym.make, name)
        imports, call, options = "import gymnasium\n", f"gymnasium.make({name!r}, ", "**options"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about newer versions and bounds
            env = make()
    except Exception as error:
        advice = ""
        if colon and re.search("required .*argument", str(error)):
            advice = f"; name a function without required arguments: --env {file}.py:FUNCTION"
        if isinstance(error, gym.error.UnregisteredEnv):
            advice = (
                "; if a package registers the ID, write PACKAGE:ID, as in highway_env:highway-v0; "
                "if the environment is your own, write FILE.py:CLASS or FILE.py:FUNCTION"
            )
        raise TaskError(f"--env {name}: {_message(error)}{advice}") from error
    if not isinstance(env, gym.Env):
        raise TaskError(f"--env {name}: it made a {type(env).__name__}, not a gymnasium.Env")
    expression = f"{call}{options})"
    if colon and not env.has_wrapper_attr("_max_episode_steps"):
        imports = f"from gymnasium.wrappers import TimeLimit\n{imports}"
        expression = f"TimeLimit({expression}, 500)  # steps after which an episode is truncated"
    try:
        parameters = options and f"{options}: Any"
        yield env, {"imports": imports, "parameters": parameters, "expression": expression}
    finally:
        with contextlib.suppress(Exception):
            env.close()


def _of_file(option: str, file: Path, attribute: str) -> Callable[[], Any]:
    if not (file.stem.isidentifier() and attribute.isidentifier()):
        raise TaskError(f"{option}: in file and class names, use letters, digits and underscores")
    if file.parent != Path():
        raise TaskError(f"{option}: run the command in the folder of {file.name}")
    make: Callable[[], Any] = attribute_of(import_file(file, option), attribute, option)
    return make


def _message(error: Exception) -> str:
    """Return what an exception of the environment says; where it is silent, where it arose."""
    kind = type(error).__name__
    if text := str(error):
        return f"{kind}: {text}"
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{kind} in {last.filename}:{last.lineno}: {last.line}"


# Its actions and observations --------------------------------------------------------------------


class Entry(NamedTuple):
    """An action or a number of an observation: its name in the domain file.

    `value` is the environment action, or the expression of the number, in Python; `comment` one
    line of the environment's documentation.
    """

    name: str
    value: str
    comment: str


def describe(env: gym.Env[Any, Any], called: str) -> tuple[list[Entry], list[Entry], float | None]:
    """Return actions, observed numbers and, where it has one, the period of an environment.

    `called` is what it is called in messages.

    Raises:
        TaskError: Its actions are not discrete, its observations are no numbers, or there are too
            many of either.
    """
    try:
        space, observations = ActionSpace(env.action_space), Observations(env.observation_space)
    except ValueError as error:
        raise TaskError(
            f"{called}: {error}; write a function that returns the environment in a suitable "
            "wrapper, and give the function as --env FILE.py:FUNCTION"
        ) from None
    if space.size > MOST:
        raise TaskError(
            f"{called} has {space.size:,} actions; a new file can have at most {MOST}. Offer the "
            "useful ones with gymnasium.wrappers.TransformAction"
        )
    if observations.size == 0:
        raise TaskError(f"{called}: an observation has no numbers")
    pictures: list[str] = []
    every = _numbers(env.observation_space, "observation", "observation", pictures)
    fields = list(itertools.islice(every, MOST + 1))
    if len(fields) > MOST:
        raise TaskError(
            f"an observation of {called} has more than {MOST} numbers, too many for one fluent "
            "each; select the important ones with gymnasium.wrappers.TransformObservation, or "
            "write the task yourself (how-to: Connect your own environment)"
        )
    documentation = inspect.getdoc(type(env.unwrapped)) or ""
    used: set[str] = set()
    actions = []
    titles = _action_names(env, space.size) or numbered(documentation, "Action Space", space.size)
    for k, title in enumerate(titles):
        action = space.action(k)
        value, otherwise = str(k), f"action-{k}"
        if isinstance(action, np.ndarray):
            value = repr(tuple((action - getattr(space.space, "start", 0)).ravel().tolist()))
            otherwise = f"action-{'-'.join(map(str, action.ravel().tolist()))}"
        actions.append(_entry(used, title, otherwise, value))
    used = set()
    titles = numbered(documentation, "Observation Space", len(fields))
    numbers = [_entry(used, title, *field) for title, field in zip(titles, fields, strict=True)]
    # What a picture shows is for the user to say; a name shows where.
    numbers += [Entry(_name_of("seen", "seen", used), "0.0", f"compute it from {picture}")
                for picture in pictures]  # fmt: skip
    period = None
    with contextlib.suppress(Exception):  # it may be a property of the environment
        period = real(getattr(env.unwrapped, "dt", None))
    return actions, numbers, float(period) if period and period > 0 else None


def _entry(used: set[str], text: str, otherwise: str, value: str, bounds: str = "") -> Entry:
    """Return an entry; a comment that only repeats the name is left out."""
    name = _name_of(text or otherwise, otherwise, used)
    comment = "" if re.findall(r"\w+", text.lower()) == name.split("-") else remark(text)
    return Entry(name, value, ", ".join(filter(None, (comment, bounds))))


def _action_names(env: gym.Env[Any, Any], count: int) -> list[str]:
    """Return the names that an environment, or its outermost wrapper with names, has for actions.

    They are an enumeration, a mapping from numbers or a sequence. The list is empty without them.
    """
    for attribute in ("get_action_meanings", "action_names", "actions", "action_type"):
        with contextlib.suppress(Exception):  # the environment's own code
            names = env.get_wrapper_attr(attribute)
            if attribute == "get_action_meanings":
                names = names()
            elif attribute == "action_type":
                names = names.actions
            if isinstance(names, EnumMeta):
                names = {member.value: member.name for member in list[Enum](names)}
            if isinstance(names, Mapping):
                names = [names[k] for k in range(len(names))]
            if (
                not isinstance(names, str)
                and len(names) == count
                and all(isinstance(name, str) for name in names)
            ):
                return [name.replace("_", " ").lower() for name in names]
    return []


def _numbers(
    space: Any, expression: str, name: str, pictures: list[str]
) -> Iterator[tuple[str, str, str]]:
    """Yield name, expression in Python, and bounds of each number of an observation.

    Parts with too many numbers, such as pictures, are added to `pictures` instead.
    """
    if isinstance(space, spaces.Dict):
        for key, part in space.spaces.items():
            if not isinstance(key, str):
                raise TaskError(f"the observation has a part named {key!r}; use strings as names")
            inner = key if name == "observation" else f"{name} {key}"
            yield from _numbers(part, f"{expression}[{key!r}]", inner, pictures)
    elif isinstance(space, spaces.Tuple):
        for k, part in enumerate(space.spaces):
            yield from _numbers(part, f"{expression}[{k}]", f"{name}-{k}", pictures)
    elif isinstance(space, spaces.Discrete):
        yield name, expression, f"{space.start} to {space.start + space.n - 1}"
    elif math.prod(shape := tuple(space.shape or ())) > MOST:
        pictures.append(remark(expression))
    elif not is_text(space):
        for place in itertools.product(*map(range, shape)):
            at = f"[{', '.join(map(str, place))}]" if place else ""
            low, high = 0.0, 1.0
            if isinstance(space, spaces.Box):
                low, high = float(space.low[place]), float(space.high[place])
            elif isinstance(space, spaces.MultiDiscrete):
                low = float(np.asarray(space.start)[place])
                high = low + float(np.asarray(space.nvec)[place]) - 1
            unbounded = np.isinf(low) and np.isinf(high)
            bounds = "unbounded" if unbounded else f"{low:.4g} to {high:.4g}"
            yield "-".join([name, *map(str, place)]), f"{expression}{at}", bounds


def numbered(documentation: str, heading: str, count: int) -> list[str]:
    """Return the texts beside the numbers 0 ... count-1 under a heading of a documentation.

    They are empty where there is no such list or table. Of several lists the first counts.
    """
    begin = re.compile(rf"^\s*#+[\s*]*{heading}[\s*]*$", re.M | re.I).search(documentation)
    section = _HEADING.split(documentation[begin.end() :])[0] if begin else ""
    texts: list[str] = []
    for line in section.splitlines():
        match = _ROW.match(line) or _ITEM.match(line)
        if match and int(match[1]) == len(texts) and match[2]:
            texts.append(match[2])
        elif match and int(match[1]) == 0:
            break  # another list
    return texts if len(texts) == count else [""] * count


def _name_of(text: str, otherwise: str, used: set[str]) -> str:
    """Return a new name of PDDL made of the first sentence of a text, brackets left out.

    It is made of `otherwise` where the text has no letters.
    """
    longest = 40
    plain = unicodedata.normalize("NFKD", _ASIDE.sub("", text)).encode("ascii", "ignore")
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", _MINUS.sub("minus ", plain.decode()))
    words = re.split(r"[.;:,](?:\s|$)", words.strip())[0].lower().replace("'", "")
    name = "-".join(re.findall(r"[a-z0-9]+", words))
    while len(name) > longest and "-" in name:
        name = name.rpartition("-")[0]
    name = name[:longest].strip("-")
    if not re.search("[a-z]", name):
        name = "-".join(re.findall(r"[a-z0-9]+", otherwise.lower())) or "entry"
    if not name[0].isalpha() or name in _RESERVED:
        name = f"the-{name}"
    numbers = (f"{name}-{number}" for number in itertools.count(2))
    unique = next(n for n in itertools.chain([name], numbers) if n not in used)
    used.add(unique)
    return unique


# Texts -------------------------------------------------------------------------------------------


def remark(text: str) -> str:
    """Return a text for a comment of one line: no line breaks, control characters and quotes."""
    plain = "".join(c if c.isprintable() and c not in '"\\' else " " for c in text)
    return " ".join(plain.split())[:100]


def _texts(name: str, env: str, made: gym.Env[Any, Any], in_python: dict[str, str]) -> list[str]:
    """Return domain, task and scenarios; texts of the environment stand in comments and quotes."""
    actions, numbers, dt = describe(made, f"--env {env}")
    width = max(7, *(len(entry.name) for entry in numbers))
    functions = [f"    ({e.name}){_comment(e, width - len(e.name))}" for e in numbers]
    functions.append(
        f"    (reward)){' ' * (width - 7)}  ; reserved: its increase is the reward of a step"
    )
    schemas = [f"  (:action {entry.name}{_comment(entry)}\n"
               "    :parameters ()\n    :precondition (and)\n    :effect (and))\n"
               for entry in actions]  # fmt: skip
    values = {
        **{"name": name, "env": remark(env), "first": numbers[0].name, "action": actions[0].name},
        **{"functions": "\n".join(functions), "schemas": "\n".join(schemas)},
        **in_python,
        **{"fields": _items(numbers, 8), "actions": _items(actions, 12), "dt": dt or 1.0},
    }
    templates = ("environment.pddl", "adapter.txt", "environment.scenarios")
    return [_filled(template, **values) for template in templates]


def _items(entries: Iterable[Entry], indent: int) -> str:
    return "\n".join(f'{" " * indent}"{entry.name}": {entry.value},' for entry in entries)


def _comment(entry: Entry, blanks: int = 0) -> str:
    return f"{' ' * blanks}  ; {entry.comment}" if entry.comment else ""


def _filled(template: str, **values: Any) -> str:
    text = resources.files(__package__).joinpath("templates", template).read_text("utf-8")
    return Template(text).substitute(values)
