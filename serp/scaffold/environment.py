"""What an environment tells of itself: its actions, and the numbers of its observations."""

from __future__ import annotations

import inspect
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import EnumMeta
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from serp._util.numbers import real
from serp._util.text import plural
from serp.errors import TaskError
from serp.scaffold.documentation import numbered
from serp.scaffold.names import Names, remark
from serp.tasks.action_space import ActionSpace
from serp.tasks.observation import Observations

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
