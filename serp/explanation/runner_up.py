"""The best action beside the one taken, and what is between the two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from serp.model.flags import APPLICABLE
from serp.planning.preference import path_score, rank_of

if TYPE_CHECKING:
    from serp.explanation.predicted import Predicted
    from serp.planning.preference import PathScore

By = Literal["rank", "risk", "safe steps", "value", "delay", "order"]
_BY: Final[tuple[By, ...]] = ("rank", "risk", "safe steps", "value")
"""What decides, in this order: see `serp.planning.preference`."""
_ALIKE: Final = 1e-12
"""Share of two values up to which they are alike: what is put off is worth the same at discount 1,
and a planner that sees this tells the two apart by the least number that there is."""


@dataclass(frozen=True)
class RunnerUp:
    """The best action beside the one taken, by the order in which a planner prefers actions.

    Attributes:
        action: Its position.
        name: Its name.
        ahead: Whether the planner prefers the action taken to it; False where somebody else than
            the planner had the choice.
        by: What decides between the two: `rank` (safe before risky before unsafe), the `risk` of
            the path, its `safe steps`, its `value`, the `delay` (both are worth the same, but one
            only puts it off), or the `order` in the file.
        gap: Best return of the action taken less that of this one, in units of the reward.
        path_risks: Probability of an unsafe step on the path of the action taken, and on its own.
    """

    action: int
    name: str
    ahead: bool
    by: By
    gap: float
    path_risks: tuple[float, float]


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
    return compared(predicted, names, chosen, max(scores, key=lambda k: (scores[k], -k)))


def compared(predicted: Predicted, names: Sequence[str], chosen: int, other: int) -> RunnerUp:
    """Return another action beside the one taken, as if it were the best other one."""
    own, others = _score(predicted, chosen), _score(predicted, other)
    if not int(predicted.flags[chosen]) & APPLICABLE:
        own = path_score(3, 1.0, -1, -np.inf)
    by: By = next((by for by, a, b in zip(_BY, own, others, strict=True) if a != b), "order")
    value, worse = float(predicted.value[chosen]), float(predicted.value[other])
    gap = 0.0 if value == worse else value - worse  # both may be infinite
    if by == "value" and abs(gap) <= _ALIKE * abs(value) < np.inf:
        by = "delay"
    risks = float(predicted.path_risk[chosen]), float(predicted.path_risk[other])
    return RunnerUp(other, names[other], (own, -chosen) > (others, -other), by, gap, risks)


def _score(of: Predicted, k: int) -> PathScore:
    rank, steps = rank_of(int(of.flags[k])), int(of.safe_steps[k])
    return path_score(rank, float(of.path_risk[k]), steps, float(of.value[k]))
