"""What would have had to differ: the smallest change of one fluent that changes an outcome.

The outcome is computed, not guessed: a planner plans in the changed state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from serp._util.text import listed, plural
from serp.model.transition_model import StateError

if TYPE_CHECKING:
    from serp.model.ground import Fluent
    from serp.model.transition_model import TransitionModel, Vector


Outcome = Callable[["Vector"], int]
"""State `[F]` → what comes of it, such as the position of the chosen action."""

_POINTS: Final = 48
"""Values on each side of the present one that are tried of a fluent."""
_HALVINGS: Final = 30
"""Steps of bisection."""


@dataclass(frozen=True)
class Flip:
    """A change of one fluent that changes the outcome.

    Attributes:
        fluent: Its name.
        value: Its value in the state.
        becomes: The value nearest to it with another outcome.
        outcome: That outcome, in words.
        share: Size of the change as a share of the range of the fluent; 1 for a predicate.
    """

    fluent: str
    value: float | bool
    becomes: float | bool
    outcome: str
    share: float


@dataclass(frozen=True)
class Flips:
    """The changes that were found, the smallest first, and a sentence on what was searched."""

    found: tuple[Flip, ...]
    searched: str


def flips_of(
    outcome: Outcome,
    model: TransitionModel,
    state: Vector,
    ranges: tuple[Vector, Vector],
    *,
    whole: Collection[int] = (),
    called: Callable[[int], str] = str,
    seconds: float = math.inf,
) -> Flips:
    """Search the smallest change of each fluent, alone, that changes the outcome.

    A numeric fluent is tried at points from its value to both ends of its range, and the first of
    them with another outcome is approached by bisection; an outcome that changes and changes back
    between two points may be overlooked. A predicate is negated. A change is left out with which
    the task would have ended, or harm been done, before anything is decided.

    Args:
        outcome: What comes of a state.
        model: The model whose fluents are changed.
        state: `[F]`.
        ranges: Smallest and largest value `[F]` of each fluent; one that never differs is left out.
        whole: Positions of the numeric fluents that are tried at whole numbers only.
        called: What an outcome is called.
        seconds: Time after which no further fluent is tried.
    """
    deadline = time.monotonic() + seconds
    now, found = outcome(state), list[Flip]()
    over = _is_over(model, state)

    def of_a_start(changed: Vector) -> int:
        there = outcome(changed)
        return now if there != now and not over and _is_over(model, changed) else there

    left: list[str] = []
    tried: list[Fluent] = []
    for fluent in model.fluents:
        low, high = float(ranges[0][fluent.index]), float(ranges[1][fluent.index])
        if fluent.numeric and not high > low:
            continue
        if time.monotonic() > deadline:
            left.append(fluent.name)
            continue
        tried.append(fluent)
        search = _Search(of_a_start, fluent, state, now, called)
        if not fluent.numeric:
            nearest = search.negated()
        elif fluent.index in whole:
            nearest = search.nearest_whole(low, high)
        else:
            nearest = search.between(low, high)
        if nearest is not None:
            found.append(nearest)
    found.sort(key=lambda flip: flip.share)
    return Flips(tuple(found), _searched(tried, left, whole))


def _is_over(model: TransitionModel, state: Vector) -> bool:
    """Return whether the file ends the task, or flags it, in a state in which nothing is done."""
    try:
        judged = model.judge(state, -1, state)
    except StateError:
        return False
    return judged.terminal or judged.unsafe


def _searched(tried: Sequence[Fluent], left: Sequence[str], whole: Collection[int]) -> str:
    counted = sum(fluent.index in whole for fluent in tried if fluent.numeric)
    numbers = sum(fluent.numeric for fluent in tried) - counted
    parts = []
    if counted:
        parts.append(f"{plural(counted, 'number')} at up to {_POINTS} whole numbers on either side")
    if numbers:
        parts.append(
            f"{plural(numbers, 'number')} at {_POINTS} points to either end of the range that was "
            "seen, then by bisection"
        )
    if len(tried) > numbers + counted:
        parts.append(f"{plural(len(tried) - numbers - counted, 'predicate')} negated")
    searched = f"Each fluent was changed alone: {'; '.join(parts) or 'none varies'}."
    return searched + (f" There was no time for {listed(left)}." if left else "")


class _Search:
    """The search along one fluent."""

    def __init__(
        self,
        outcome: Outcome,
        fluent: Fluent,
        state: Vector,
        now: int,
        called: Callable[[int], str],
    ) -> None:
        self._outcome = outcome
        self._fluent = fluent
        self._state = state.copy()
        self._value = float(state[fluent.index])
        self._now = now
        self._called = called

    def _with(self, value: float) -> int:
        self._state[self._fluent.index] = value
        return self._outcome(self._state)

    def negated(self) -> Flip | None:
        """Return the flip of a predicate, or None."""
        other = self._with(1.0 - self._value)
        if other == self._now:
            return None
        return Flip(self._fluent.name, bool(self._value), not self._value, self._called(other), 1.0)

    def _flip(self, becomes: float, outcome: int, share: float) -> Flip:
        return Flip(self._fluent.name, self._value, becomes, self._called(outcome), share)

    def nearest_whole(self, low: float, high: float) -> Flip | None:
        """Return the smallest flip to a whole number in a range, or None."""
        for distance in range(1, _POINTS + 1):
            for becomes in (self._value - distance, self._value + distance):
                if low <= becomes <= high and (other := self._with(becomes)) != self._now:
                    return self._flip(becomes, other, distance / (high - low))
        return None

    def between(self, low: float, high: float) -> Flip | None:
        """Return the smallest flip of a number towards either end, or None."""
        best: Flip | None = None
        for end in (low, high):
            same = self._value
            for point in np.linspace(self._value, end, _POINTS + 1)[1:].tolist():
                if self._with(point) == self._now:
                    same = point
                    continue
                becomes = self._border(same, point)
                share = abs(becomes - self._value) / (high - low)
                if best is None or share < best.share:
                    best = self._flip(becomes, self._with(becomes), share)
                break
        return best

    def _border(self, same: float, other: float) -> float:
        """Return the value nearest to `same` with another outcome, between the two."""
        for _ in range(_HALVINGS):
            middle = (same + other) / 2.0
            if self._with(middle) == self._now:
                same = middle
            else:
                other = middle
        return other
