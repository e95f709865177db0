"""How well the fluents, the reward and the end are predicted one step ahead, each by its change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from serp.diagnosis.error_scales import Steps, symbols_of
from serp.diagnosis.patched_model import PatchedForecast
from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.monitor import END, REWARD

_ROUNDING: Final = 1e-9

WELL: Final = 0.1
"""Predicted well is what has an error of at most 10 % of its change."""


@dataclass(frozen=True)
class Quantity:
    """How well the fluents of one symbol, the reward or the end are predicted.

    Errors are squared and summed over all its fluents, as a share of the squared change; see
    `serp.diagnosis.error_scales`.

    Attributes:
        name: The symbol; `reward`, or `terminal` for the end.
        shown: How it is written: `(battery)`.
        numeric: False for predicates and the end.
        written: Whether the file says anything of it.
        steps: Transitions looked at.
        change: Root mean square of the change in a step; for what is true or false, in how many
            steps and fluents it changes. A reward and an end are changes themselves.
        said: In how many steps and fluents the file predicts a change of a predicate, or an end.
        right: In how many of these it came.
        squared: Error of the file as written.
        squared_left: The same with what is worth mentioning taken into account.
        squared_chance: What of that is to be expected by the chances that were found.
        action: The ground action after which most of the error of the file is made.
        most: The share of the error that is made after it.
    """

    name: str
    shown: str
    numeric: bool
    written: bool
    steps: int
    change: float
    said: int
    right: int
    squared: float
    squared_left: float
    squared_chance: float
    action: str
    most: float

    @property
    def off(self) -> float:
        """Error of the file as a share of the change: 0 is perfect, 1 "everything stays as it is".

        Of root mean squares, or of numbers of steps for what is true or false.
        """
        return self._share(self.squared)

    @property
    def off_left(self) -> float:
        """The same with what is worth mentioning taken into account."""
        return self._share(self.squared_left)

    @property
    def unexplained(self) -> float:
        """The same without what is to be expected by chance."""
        return self._share(max(0.0, self.squared_left - self.squared_chance))

    def _share(self, squared: float) -> float:
        return math.sqrt(squared) if self.numeric else squared


def quantities_of(
    model: TransitionModel, steps: Steps, predicted: Vector, found: PatchedForecast, units: Vector
) -> tuple[Quantity, ...]:
    """Return what changes, or is predicted to, in the order of the file; reward and end come last.

    Args:
        model: The model as written.
        steps: What was observed.
        predicted: `[N, F + 2]` what the model predicts.
        found: The same with what is worth mentioning taken into account.
        units: `[F + 2]`.
    """
    names = np.array(symbols_of(model))
    predicates = {fluent.symbol for fluent in model.fluents if not fluent.numeric} | {END}
    moves, says = steps.after - steps.before, predicted - steps.before
    errors, left, chance = (
        np.nan_to_num(square) / units**2
        for square in (
            (steps.after - predicted) ** 2, (steps.after - found.mean) ** 2, found.variance
        )
    )  # fmt: skip
    number = max(1, len(moves))
    spoken = _spoken(model)
    quantities = []
    for name in dict.fromkeys(names.tolist()):
        own, counts = names == name, name in predicates
        changed, said = np.abs(moves[:, own]) > 0.5, np.abs(says[:, own]) > 0.5
        by_step = errors[:, own].sum(axis=1)
        squared = float(by_step.sum()) / number
        if not (np.abs(moves[:, own]) > _ROUNDING * units[own]).any() and squared <= _ROUNDING**2:
            continue
        by_action = np.bincount(steps.actions, by_step, len(model.actions))
        quantities.append(
            Quantity(
                name=name,
                shown=_shown(model, name),
                numeric=not counts,
                written=name in spoken,
                steps=len(moves),
                change=float(changed.sum() if counts else np.sqrt(np.mean(moves[:, own] ** 2))),
                said=int(said.sum()) if counts else 0,
                right=int((said & changed).sum()) if counts else 0,
                squared=squared,
                squared_left=float(left[:, own].sum()) / number,
                squared_chance=float(chance[:, own].sum()) / number,
                action=model.actions[int(by_action.argmax())].name,
                most=float(by_action.max()) / (squared * number) if squared else 0.0,
            )
        )
    return tuple(quantities)


def _spoken(model: TransitionModel) -> set[str]:
    """Return the symbols of what the file says anything of; `reward` and `terminal` among them."""
    ground = model.ground
    targets = {
        effect.target
        for schema in (*ground.actions, *ground.processes, *ground.events)
        for effect in schema.effects
    }
    spoken = {fluent.symbol for fluent in model.fluents if fluent.index in targets}
    if model.rewarding:
        spoken.add(REWARD)
    if ground.goal is not None or g.TERMINAL_TARGET in targets:
        spoken.add(END)
    return spoken


def _shown(model: TransitionModel, name: str) -> str:
    """Return how a symbol is written, with dots where several fluents are of it."""
    own = [fluent.name for fluent in model.fluents if fluent.symbol == name]
    return f"({own[0] if len(own) == 1 else name + ' …' if own else name})"
