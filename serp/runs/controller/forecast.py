"""What the planner predicts for every action, over ground actions and over environment actions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .reading import Entry
from .step import APPLICABLE, RISK_SHIFT, RISK_UNIT, RISKY, UNDEFINED, UNSAFE

SAFE = 1 << 30
"""Stands for the safe control periods of a path on which every risk is accepted."""


def rank_of(flags: int) -> int:
    """Return 0 for a step whose risk is accepted, 1 where it is not, 2 where the file flags it."""
    if flags & UNSAFE:
        return 2
    return 1 if flags & RISKY else 0


def risk_of(flags: int) -> float:
    """Return the predicted probability that a step is unsafe."""
    return 1.0 if flags & UNSAFE else (flags >> RISK_SHIFT) * RISK_UNIT


class Prospects(NamedTuple):
    """The prediction for every action, as `serp.Forecast`; lists over actions.

    Attributes:
        choice: The first action of the best path; -1 where none is applicable.
        value, path_risk, safe_steps: Of the best path that begins with each action.
        reward, flags: Of one control period.
        complete: Whether no budget of nodes ended the search.
    """

    choice: int
    value: list[float]
    path_risk: list[float]
    safe_steps: list[int]
    reward: list[float]
    flags: list[int]
    complete: bool = True

    @property
    def indifferent(self) -> bool:
        """Whether two or more actions of the best rank have the same score."""
        ranked = [(rank_of(flag), k) for k, flag in enumerate(self.flags) if flag & APPLICABLE]
        best = min(ranked, default=(0, 0))[0]
        chosen = [k for rank, k in ranked if rank == best]
        if len(chosen) < 2:
            return False
        first, columns = chosen[0], (self.value, self.path_risk, self.safe_steps)
        return all(column[k] == column[first] for column in columns for k in chosen)

    @property
    def sees_costs_alone(self) -> bool:
        """Whether it is indifferent but for what the first step gives."""
        values = np.array(self.value)
        rest = values - np.array(self.reward)
        largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        if largest > 0.0:
            rest = np.round(rest / largest, 9)
        return self._replace(value=rest.tolist()).indifferent

    def score(self, action: int) -> tuple[int, float, int, float]:
        """Return the score of the best path that begins with an action."""
        rank = rank_of(self.flags[action])
        return -rank, -self.path_risk[action], self.safe_steps[action], self.value[action]


class EnvironmentActions:
    """The map from ground actions to the actions 0 ... E-1; see `serp.planning.action_map`.

    Attributes:
        names: `[E]`.
        modelled: `[E]` whether the model knows an action.
        first: `[E]` the first ground action of each; -1 for none.
        one_to_one: Whether no two ground actions share one.
    """

    def __init__(self, data: Entry, ground: int) -> None:
        self.names = [name.text() for name in data["names"].items()]
        groups = data["groups"]
        self._groups = [group.positions(ground) for group in groups.items(len(self.names))]
        if sorted(k for group in self._groups for k in group) != list(range(ground)):
            raise groups.wrong(f"each of {ground} ground actions must be in one group")
        self._action = {k: a for a, group in enumerate(self._groups) for k in group}
        self.modelled = [bool(group) for group in self._groups]
        self.first = [group[0] if group else -1 for group in self._groups]
        self.one_to_one = all(len(group) <= 1 for group in self._groups)

    def project(self, of: Prospects) -> Prospects:
        """Return predictions for ground actions as those for environment actions."""
        counted = self.first if self.one_to_one else [self._counted(of, g) for g in self._groups]
        choice = self._action[of.choice] if of.choice >= 0 else -1
        value = [of.value[k] if k >= 0 else -np.inf for k in counted]
        risk = [of.path_risk[k] if k >= 0 else 0.0 for k in counted]
        steps = [of.safe_steps[k] if k >= 0 else SAFE for k in counted]
        reward = [of.reward[k] if k >= 0 else 0.0 for k in counted]
        flags = [of.flags[k] if k >= 0 else 0 for k in counted]
        found = Prospects(choice, value, risk, steps, reward, flags, of.complete)
        if self.one_to_one:
            return found
        for action, group in enumerate(self._groups):
            together = [k for k in group if of.flags[k] & APPLICABLE]
            if len(together) > 1 and flags[action] & APPLICABLE:
                value[action] = min(of.value[k] for k in together)
                risk[action] = max(of.path_risk[k] for k in together)
                steps[action] = min(of.safe_steps[k] for k in together)
                reward[action] = min(of.reward[k] for k in together)
        possible = [a for a, flag in enumerate(flags) if flag & APPLICABLE]
        possible.sort(key=lambda a: self._groups[a][0])
        return found._replace(choice=max(possible, key=found.score, default=-1))

    def _counted(self, of: Prospects, group: list[int]) -> int:
        """Return the ground action that counts for an environment action: the worst possible."""
        possible = [k for k in group if of.flags[k]]
        if not possible:
            return group[0] if group else -1
        return min(
            possible,
            key=lambda k: (
                not of.flags[k] & UNSAFE,
                not of.flags[k] & UNDEFINED,
                -risk_of(of.flags[k]),
                -of.path_risk[k],
                of.safe_steps[k],
                of.reward[k],
            ),
        )
