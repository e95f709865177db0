"""Checks of what an environment returns from `reset` and `step`.

Every function raises an EnvironmentFailure that says what was returned and what is expected.
"""

from __future__ import annotations

import copy
import math
import reprlib
from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np

from serp.errors import EnvironmentFailure


def step_answer(answer: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
    """Return observation, reward, terminated, truncated and info, copied.

    The reward must be finite; reward, terminated and truncated may be arrays of one element.
    """
    wanted = "the five values (observation, reward, terminated, truncated, info)"
    raw, reward, terminated, truncated, info = _taken_apart(answer, 5, wanted)
    return (
        _owned(raw),
        _number(reward, "the reward"),
        _truth(terminated, "terminated"),
        _truth(truncated, "truncated"),
        _info(info),
    )


def reset_answer(answer: Any) -> tuple[Any, dict[str, Any]]:
    """Return observation and info, copied."""
    raw, info = _taken_apart(answer, 2, "the two values (observation, info)")
    return _owned(raw), _info(info)


def _taken_apart(answer: Any, count: int, wanted: str) -> tuple[Any, ...]:
    if not isinstance(answer, tuple | list):
        raise EnvironmentFailure(f"it returned {_shown(answer)}, not {wanted}")
    if len(answer) != count:
        raise EnvironmentFailure(f"it returned {len(answer)} values, not {wanted}")
    return tuple(answer)


def _owned(raw: Any) -> Any:
    """Return a copy of an observation, because environments reuse their buffers."""
    return copy.deepcopy(raw) if isinstance(raw, np.ndarray | Mapping | tuple | list) else raw


def _number(value: Any, what: str) -> float:
    element = single(value)
    if not isinstance(element, Real):
        advice = ""
        if getattr(element, "shape", ()):
            advice = "; weigh its parts in a wrapper, such as gymnasium.wrappers.TransformReward"
        raise EnvironmentFailure(f"{what} is {_shown(value)}, not one number{advice}")
    try:
        number = float(element)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise EnvironmentFailure(f"{what} is {number}, not a finite number")
    return number


def _truth(value: Any, what: str) -> bool:
    element = single(value)
    if isinstance(element, Real) and element in (0, 1):
        return bool(element)
    raise EnvironmentFailure(f"{what} is {_shown(value)}, not True or False")


def _info(value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise EnvironmentFailure(f"info is {_shown(value)}, not a dictionary")
    return dict(value)


def single(value: Any) -> Any:
    """Return the only element of an array, a tensor or a NumPy scalar; else the value itself."""
    if isinstance(value, bool | int | float) or not hasattr(value, "__array__"):
        return value
    try:
        array = np.asarray(value)
    except Exception:  # a tensor with a gradient refuses, and others may raise anything
        return value
    return array.item() if array.size == 1 else value


def _shown(value: Any) -> str:
    return f"{reprlib.repr(value)} ({type(value).__name__})"
