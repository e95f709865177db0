"""What would have had to differ: the smallest change of one fluent that changes an outcome.

The outcome is computed, not guessed: a planner plans in the changed state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from serp._util.did_you_mean import listed
from serp.model.transition_model import StateError

if TYPE_CHECKING:
    from serp.model.transition_model import TransitionModel, Vector


_POINTS: Final = 48
"""Values on each side of the present one that are tried of a fluent."""


@dataclass(frozen=True)
class Counterfactual:
    """A change of one fluent that changes the outcome.

    `becomes` is the value nearest to its `value` in the state with another `outcome`; `share` is
    the size of the change as a share of the range of the fluent, 1 for a predicate.
    """

    fluent: str
    value: float | bool
    becomes: float | bool
    outcome: str
    share: float


@dataclass(frozen=True)
class Counterfactuals:
    """The changes that change the outcome, the smallest first, and a sentence on the search."""

    changes: tuple[Counterfactual, ...]
    searched: str


def counterfactuals(
    outcome: Callable[[Vector], int],
    model: TransitionModel,
    state: Vector,
    ranges: tuple[Vector, Vector],
    *,
    whole: Collection[int] = (),
    called: Callable[[int], str] = str,
    seconds: float = math.inf,
) -> Counterfactuals:
    """Search the smallest change of each fluent, alone, that changes the outcome.

    A fluent is changed within its range only; one that never varied is left alone. Changes that end
    the task, or that the file flags, are not tried where the task goes on.

    Args:
        outcome: State `[F]` → outcome, such as the position of the chosen action.
        model: The model whose fluents these are.
        state: `[F]`.
        ranges: Least and largest value of each fluent, each `[F]`.
        whole: Positions of fluents with whole numbers only.
        called: Outcome → its name.
        seconds: Time after which no further fluent is tried.
    """
    deadline = time.monotonic() + seconds
    now, changes = outcome(state), list[Counterfactual]()
    over = _is_over(model, state)
    omitted: list[str] = []
    for fluent in model.fluents:
        low, high = float(ranges[0][fluent.index]), float(ranges[1][fluent.index])
        if fluent.numeric and not high > low:
            continue
        if time.monotonic() > deadline:
            omitted.append(fluent.name)
            continue
        changed, value = state.copy(), float(state[fluent.index])

        def at(becomes: float, changed: Vector = changed, index: int = fluent.index) -> int:
            changed[index] = becomes
            other = outcome(changed)
            return now if other != now and not over and _is_over(model, changed) else other

        if not fluent.numeric:
            candidates = iter([1.0 - value])
        elif fluent.index in whole:
            steps = (value + sign * k for k in range(1, _POINTS + 1) for sign in (-1, 1))
            candidates = (becomes for becomes in steps if low <= becomes <= high)
        else:
            borders = [_border(at, now, value, end) for end in (low, high)]
            found = [border for border in borders if border is not None]
            candidates = iter(sorted(found, key=lambda becomes: abs(becomes - value)))
        nearest = next((becomes for becomes in candidates if at(becomes) != now), None)
        if nearest is not None:
            shown = float if fluent.numeric else bool
            share = abs(nearest - value) / (high - low) if fluent.numeric else 1.0
            name = called(at(nearest))
            changes.append(Counterfactual(fluent.name, shown(value), shown(nearest), name, share))
    changes.sort(key=lambda change: change.share)
    searched = "Each fluent was changed alone, within its observed range."
    if omitted:
        searched += f" Not tested (time limit): {listed(omitted)}."
    return Counterfactuals(tuple(changes), searched)


def _border(at: Callable[[float], int], now: int, value: float, end: float) -> float | None:
    """Return the value nearest to the present one, towards an end, with another outcome."""
    same = value
    for point in np.linspace(value, end, _POINTS + 1)[1:].tolist():
        if at(point) == now:
            same = point
            continue
        other: float = point
        for _ in range(30):
            middle = (same + other) / 2.0
            if at(middle) == now:
                same = middle
            else:
                other = middle
        return other
    return None


def _is_over(model: TransitionModel, state: Vector) -> bool:
    """Return whether the file ends the task, or flags it, in a state in which nothing is done."""
    try:
        judged = model.judge(state, -1, state)
    except StateError:
        return False
    return judged.terminal or judged.unsafe
