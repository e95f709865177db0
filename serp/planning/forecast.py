"""The planner's prediction for every action in one state."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model.flags import APPLICABLE, RISKY, UNSAFE, risks_of
from serp.planning.preference import PathScore, path_score, rank_of

SAFE = 1 << 30
"""Stands for the safe control periods of a path on which every risk is accepted."""


class Bound(IntEnum):
    """What ended the expansion of the planning graph.

    `DEPTH`: so many layers were asked for. `NODES`: a budget was spent. `EXHAUSTED`: all
    that can be reached is in the graph. `CELLS`: the last layer, whose states have the values of a
    graph over cells, which holds all that is known and can be reached. `UNKNOWN`: the same, and
    nothing known there is worth more than going on, so the plan leads to what is not known, whose
    value is the most that there could be. `SAFETY`: nothing but whether actions are safe was asked.
    """

    DEPTH = 0
    NODES = 1
    EXHAUSTED = 2
    CELLS = 3
    UNKNOWN = 4
    SAFETY = 5

    @property
    def partial(self) -> bool:
        """Whether returns are partial: those of the lookahead, without what comes later."""
        return self in (Bound.DEPTH, Bound.NODES)


class Forecast(NamedTuple):
    """The planner's prediction for every action in one state.

    Attributes:
        choice: The first action of the best path; -1 where no action is applicable, and where the
            bound is SAFETY: then nothing is planned, and values are NaN. At every node actions are
            ordered by rank (safe before risky before unsafe), then by the least `path_risk`, the
            largest `safe_steps`, the largest `value`, and the order of the file.
        value: `[A]` discounted sum of rewards of the best path that begins with each action, plus
            the value of its last state where `Lookahead.leaves` is set; -inf where not applicable.
        path_risk: `[A]` probability, in [0, 1], of an unsafe step on that path; steps whose risk is
            accepted count as 0, and a path whose risk is accepted has that of the safest action of
            its rank. 1 if the path contains a step that the file flags, or a state in which every
            action that might be applicable has an undefined result; 1 where not applicable.
        safe_steps: `[A]` control periods on that path before the first step that has a risk, or
            before such a state; SAFE where there is none, -1 where not applicable. A path whose
            risk is accepted has those of the safest action, too.
        reward: `[A]` predicted reward of one control period.
        flags: `[A]` predicted for one control period, see `serp.model.flags`.
        depth: Layers that were expanded.
        bound: What ended the expansion.
    """

    choice: int
    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]
    depth: int
    bound: Bound

    @property
    def applicable(self) -> NDArray[np.bool_]:
        """`[A]` whether the precondition holds."""
        return (self.flags & APPLICABLE).astype(np.bool_)

    @property
    def unsafe(self) -> NDArray[np.bool_]:
        """`[A]` whether the file flags the action."""
        return (self.flags & UNSAFE).astype(np.bool_)

    @property
    def safe(self) -> bool:
        """Whether every risk on the chosen path is accepted."""
        return self.choice >= 0 and int(self.safe_steps[self.choice]) == SAFE

    @property
    def indifferent(self) -> bool:
        """Whether there are two or more actions to choose from and all have the same score.

        The actions to choose from are those of the best rank, see `serp.planning.preference`.
        """
        values: list[float] = self.value.tolist()
        if len(set(values)) == len(values):
            return False
        tied = self._tied
        return len(tied) > 1 and all(values[k] == values[tied[0]] for k in tied)

    @property
    def sees_costs_alone(self) -> bool:
        """Whether it is indifferent but for what the first step gives: the cost of acting."""
        values: list[float] = self.value.tolist()
        rest = [value - reward for value, reward in zip(values, self.reward.tolist(), strict=True)]
        largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
        if largest > 0.0:  # differences by rounding are none
            rest = [_rounded(part / largest) for part in rest]
        if len(set(rest)) == len(rest):
            return False
        tied = self._tied
        return len(tied) > 1 and all(rest[k] == rest[tied[0]] for k in tied)

    @property
    def _tied(self) -> list[int]:
        """The actions of the best rank, if all have the same risk and safe steps; else none."""
        # Lists, because arrays of a few actions take ten times as long.
        flags: list[int] = self.flags.tolist()
        ranks = [rank_of(flag) if flag & APPLICABLE else 3 for flag in flags]
        best = min(ranks, default=3)
        if best == 3:
            return []
        tied = [k for k, rank in enumerate(ranks) if rank == best]
        for column in (self.path_risk.tolist(), self.safe_steps.tolist()):
            if any(column[k] != column[tied[0]] for k in tied):
                return []
        return tied


def _rounded(number: float) -> float:
    """Return the number of billionths; the number itself where it is not finite."""
    billionths = number * 1e9
    return round(billionths) if math.isfinite(billionths) else number


def forecast_of(fields: tuple[Any, ...]) -> Forecast:
    """Return the forecast whose fields compiled code returned."""
    return Forecast._make((*fields[:-1], Bound(fields[-1])))


def held_back(of: Any) -> float:
    """Return the least risk to accept for an action that is worth more than the choice.

    `of` is a kind of forecast. 0 where no such action is left out for its risk, or is flagged.
    """
    choice = of.choice
    if choice < 0 or not (of.flags & RISKY).any():
        return 0.0
    chance = ((of.flags & (RISKY | UNSAFE)) == RISKY) & (of.path_risk < 1.0)
    chance &= of.value > of.value[choice]
    needed = np.maximum(of.path_risk - of.path_risk[choice], risks_of(of.flags))
    return float(needed[chance].min(initial=1.0)) if chance.any() else 0.0


def score_of(of: Any, action: int) -> PathScore:
    """Return the score of the best path that begins with an action, by a kind of forecast."""
    rank, steps = rank_of(int(of.flags[action])), int(of.safe_steps[action])
    return path_score(rank, float(of.path_risk[action]), steps, float(of.value[action]))


def advised(found: Forecast, action: int, worth: float = -np.inf) -> Forecast:
    """Return a forecast whose choice is the advised action, unless another one risks less.

    Args:
        found: The planner's own forecast, which knows the risks.
        action: Position of the advised ground action; -1: none.
        worth: Discounted sum of rewards that it leads to, if that is known. Its value is at least
            a little larger than those of all others.
    """
    if action < 0 or not found.flags[action] & APPLICABLE:
        return found
    others = np.delete(found.value, action)
    best = others[np.isfinite(others)].max(initial=-np.inf)
    value = found.value.copy()
    value[action] = max(value[action], worth)
    if np.isfinite(best):
        value[action] = max(value[action], best + 1e-9 * max(1.0, abs(best)))
    claimed = found._replace(value=value)
    if score_of(claimed, action) < score_of(claimed, found.choice):
        return found
    return claimed._replace(choice=action)
