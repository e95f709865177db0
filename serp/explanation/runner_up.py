"""The best action beside the one taken: what is between the two, and what would have tipped it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from serp._util.text import plural
from serp.model.flags import APPLICABLE
from serp.planning.forecast import Forecast
from serp.planning.preference import path_score, rank_of

if TYPE_CHECKING:
    from serp.explanation.decision import Predicted
    from serp.model.ground import Fluent
    from serp.model.transition_model import Vector
    from serp.planning.preference import PathScore

By = Literal["rank", "risk", "safe steps", "value", "order"]
_BY: Final[tuple[By, ...]] = ("rank", "risk", "safe steps", "value")
"""What decides, in this order: see `serp.planning.preference`."""
_POINTS: Final = 48
"""Values on each side of the present one that are tried of a fluent."""
_HALVINGS: Final = 30
"""Steps of bisection."""


@dataclass(frozen=True)
class RunnerUp:
    """The best action beside the one taken, by the order in which a planner prefers actions.

    Attributes:
        action: Its position.
        name: Its name.
        ahead: Whether the planner prefers the action taken to it; False where somebody else than
            the planner had the choice.
        by: What decides between the two: `rank` (safe before risky before unsafe), the `risk` of
            the path, its `safe steps`, its `value`, or the `order` in the file.
        gap: Best return of the action taken less that of this one, in units of the reward.
    """

    action: int
    name: str
    ahead: bool
    by: By
    gap: float


@dataclass(frozen=True)
class Flip:
    """A change of one fluent with which another action is chosen.

    Attributes:
        fluent: Its name.
        value: Its value in the state.
        becomes: The value nearest to it with which another action is chosen.
        action: Position of that action.
        share: Size of the change as a share of the range of the fluent.
    """

    fluent: str
    value: float
    becomes: float
    action: int
    share: float


@dataclass(frozen=True)
class Flips:
    """What was found of changes of one fluent alone, the smallest first, and what was searched."""

    found: tuple[Flip, ...]
    searched: str


def runner_up_of(predicted: Predicted, names: Sequence[str], chosen: int | None) -> RunnerUp | None:
    """Return the best action beside the one taken; None where no other is applicable."""
    if chosen is None:
        return None
    scores = {
        k: _score(predicted, k)
        for k, flags in enumerate(predicted.flags.tolist())
        if flags & APPLICABLE and k != chosen
    }
    if not scores:
        return None
    other = max(scores, key=lambda k: (scores[k], -k))
    own, others = _score(predicted, chosen), scores[other]
    if not int(predicted.flags[chosen]) & APPLICABLE:
        own = path_score(3, 1.0, -1, -np.inf)
    by: By = next((by for by, a, b in zip(_BY, own, others, strict=True) if a != b), "order")
    gap = float(predicted.value[chosen] - predicted.value[other])
    return RunnerUp(other, names[other], (own, -chosen) > (others, -other), by, gap)


def _score(of: Predicted, k: int) -> PathScore:
    rank, steps = rank_of(int(of.flags[k])), int(of.safe_steps[k])
    return path_score(rank, float(of.path_risk[k]), steps, float(of.value[k]))


def flips_of(
    forecast: Callable[[Vector], Forecast],
    fluents: Sequence[Fluent],
    state: Vector,
    ranges: tuple[Vector, Vector],
) -> Flips:
    """Search the smallest change of each fluent, alone, with which the planner chooses otherwise.

    A numeric fluent is tried at points from its value to both ends of its range, and the first of
    them with another choice is approached by bisection; a change back within less than the distance
    of two points may be overlooked. A predicate is negated.

    Args:
        forecast: The planner: state `[F]` → what it predicts.
        fluents: The fluents.
        state: `[F]`.
        ranges: Smallest and largest value `[F]` of each fluent.
    """
    choice = forecast(state).choice
    found: list[Flip] = []
    for fluent in fluents:
        low, high = float(ranges[0][fluent.index]), float(ranges[1][fluent.index])
        if fluent.numeric and not high > low:
            continue
        nearest = _flip_of(forecast, fluent, state, choice, low, high)
        if nearest is not None:
            found.append(nearest)
    found.sort(key=lambda flip: flip.share)
    numeric = sum(f.numeric and ranges[1][f.index] > ranges[0][f.index] for f in fluents)
    truths = sum(not f.numeric for f in fluents)
    searched = f"Each fluent was changed alone: {plural(numeric, 'number')} at {_POINTS} points to "
    searched += "either end of the range that was seen, then by bisection"
    if truths:
        searched += f"; {plural(truths, 'predicate')} negated"
    return Flips(tuple(found), searched + ".")


def _flip_of(
    forecast: Callable[[Vector], Forecast],
    fluent: Fluent,
    state: Vector,
    choice: int,
    low: float,
    high: float,
) -> Flip | None:
    """Return the smallest change of one fluent that changes the choice, or None."""
    changed, now = state.copy(), float(state[fluent.index])

    def chosen(value: float) -> int:
        changed[fluent.index] = value
        return forecast(changed).choice

    if not fluent.numeric:
        other = chosen(1.0 - now)
        return None if other == choice else Flip(fluent.name, now, 1.0 - now, other, 1.0)
    best: Flip | None = None
    for end in (low, high):
        same = now
        for point in np.linspace(now, end, _POINTS + 1)[1:].tolist():
            if (
                best is not None
                and abs(point - now) > abs(best.becomes - now) + (high - low) / _POINTS
            ):
                break
            other = chosen(point)
            if other == choice:
                same = point
                continue
            for _ in range(_HALVINGS):
                middle = (same + point) / 2.0
                if chosen(middle) == choice:
                    same = middle
                else:
                    point = middle
            share = abs(point - now) / (high - low)
            if best is None or share < best.share:
                best = Flip(fluent.name, now, point, chosen(point), share)
            break
    return best
