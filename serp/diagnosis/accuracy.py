"""Accuracy of the one-step predictions of fluents, reward and end, relative to their changes.

The unit of an error is the root mean square of the change in a step. The squared errors of a
symbol, summed over its fluents, are then a fraction of its squared change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from serp.diagnosis.patched_model import PatchedForecast
from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.regression_data import RegressionData, predicted_steps, regression_data
from serp.sysid.transitions import TransitionMemory

REWARD: Final = "reward"
END: Final = "terminal"
"""Names of the quantities beside the fluents."""

_ROUNDING: Final = 1e-9
"""A change below this fraction of a value's size counts as rounding."""

WELL: Final = 0.1
"""A quantity is predicted well if its error is at most this share of its change."""


class Steps(NamedTuple):
    """Observed steps, over the fluents, the reward and the end, and what the file predicts.

    Attributes:
        sample: The transitions that the file is compared with.
        before: `[N, F + 2]`; reward and end are 0.
        after: `[N, F + 2]`; the end is 1 where the environment ended the task, else 0.
        predicted: `[N, F + 2]` predictions of the file; NaN where there is none.
        units: `[F + 2]` units of the errors.
    """

    sample: RegressionData
    before: Vector
    after: Vector
    predicted: Vector
    units: Vector

    @classmethod
    def of(cls, model: TransitionModel, experience: TransitionMemory) -> Self:
        """Compare an experience with a model as written."""
        sample = regression_data(
            model, experience.states, experience.actions, experience.next_states
        )
        rewards, over = experience.rewards[sample.positions], experience.over[sample.positions]
        before = np.column_stack((sample.states, np.zeros((len(sample), 2))))
        after: Vector = np.column_stack((sample.next_states, rewards, over))
        predicted = predicted_steps(model, sample.states, sample.actions)
        return cls(sample, before, after, predicted, _units(model, before, after, predicted))


@dataclass(frozen=True)
class Quantity:
    """The accuracy of the predictions for the fluents of one symbol, the reward or the end.

    Attributes:
        name: The symbol; `reward`, or `terminal` for the end.
        shown: How it is written: `(battery)`.
        numeric: False for predicates and the end.
        written: Whether any effect of the file changes it.
        steps: Transitions compared.
        change: Root mean square of the change in a step; for a predicate or an end the number of
            changes. A reward and an end count as changes.
        said: Number of predicted changes of a predicate, or of predicted ends.
        right: Number of these that were observed.
        squared: Squared error of the file as written.
        squared_left: The same of the file patched with the findings worth mentioning.
        squared_chance: The part of `squared_left` expected from the stochastic effects found.
        action: The ground action after which the error of the file is largest.
        most: The fraction of the error after that action.
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
        """Error of the file relative to the change; "nothing ever changes" has an error of 1.

        A ratio of root mean squares, or of numbers of steps for predicates and ends.
        """
        return self._share(self.squared)

    @property
    def off_left(self) -> float:
        """Error of the file patched with the findings worth mentioning."""
        return self._share(self.squared_left)

    @property
    def unexplained(self) -> float:
        """Error of the patched file without the expected error of the stochastic effects found."""
        return self._share(max(0.0, self.squared_left - self.squared_chance))

    def _share(self, squared: float) -> float:
        return math.sqrt(squared) if self.numeric else squared


def _units(model: TransitionModel, before: Vector, after: Vector, predicted: Vector) -> Vector:
    """Return the unit of each column: the root mean square change of its symbol.

    A symbol that never changes is measured by its predicted change; one that is not predicted to
    change either has unit 1.
    """
    names = _symbols(model)
    units = np.ones(len(names))
    largest = np.abs(np.concatenate((before, after))).max(axis=0, initial=0.0)
    for name in dict.fromkeys(names.tolist()):
        own = names == name
        least = _ROUNDING * float(largest[own].max())
        for reached in (after, predicted):
            squares = (reached - before)[:, own] ** 2
            moved = float(np.sqrt(np.nansum(squares) / max(1, len(squares))))
            if moved > least:
                units[own] = moved
                break
    return units


def quantities_of(
    model: TransitionModel, steps: Steps, found: PatchedForecast
) -> tuple[Quantity, ...]:
    """Return all quantities that change or are predicted to, in the order of the file.

    Reward and end are last.

    Args:
        model: The model as written.
        steps: The observed steps.
        found: The predictions of the model patched with findings.
    """
    names = _symbols(model)
    predicates = {fluent.symbol for fluent in model.fluents if not fluent.numeric} | {END}
    predicted, units = steps.predicted, steps.units
    moves, says = steps.after - steps.before, predicted - steps.before
    errors, left, chance = (
        np.nan_to_num(square) / units**2
        for square in (
            (steps.after - predicted) ** 2, (steps.after - found.mean) ** 2, found.variance
        )
    )  # fmt: skip
    number = max(1, len(moves))
    written = _written_symbols(model)
    quantities = []
    for name in dict.fromkeys(names.tolist()):
        own, counts = names == name, name in predicates
        changed, said = np.abs(moves[:, own]) > 0.5, np.abs(says[:, own]) > 0.5
        by_step = errors[:, own].sum(axis=1)
        squared = float(by_step.sum()) / number
        if not (np.abs(moves[:, own]) > _ROUNDING * units[own]).any() and squared <= _ROUNDING**2:
            continue
        by_action = np.bincount(steps.sample.actions, by_step, len(model.actions))
        quantities.append(
            Quantity(
                name=name,
                shown=_shown(model, name),
                numeric=not counts,
                written=name in written,
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


def _symbols(model: TransitionModel) -> NDArray[np.str_]:
    """Return the symbol of each column of `Steps`."""
    return np.array([*(fluent.symbol for fluent in model.fluents), REWARD, END])


def _written_symbols(model: TransitionModel) -> set[str]:
    """Return the symbols that an effect of the file changes, with `reward` and `terminal`."""
    ground = model.ground
    schemas = (*ground.actions, *ground.processes, *ground.events)
    targets = {effect.target for schema in schemas for effect in schema.effects}
    written = {fluent.symbol for fluent in model.fluents if fluent.index in targets}
    written |= {REWARD} if model.rewarding else set()
    ends = ground.goal is not None or g.TERMINAL_TARGET in targets
    return written | ({END} if ends else set())


def _shown(model: TransitionModel, name: str) -> str:
    """Return how a symbol is written, with dots where it has several fluents."""
    own = [fluent.name for fluent in model.fluents if fluent.symbol == name]
    return f"({own[0] if len(own) == 1 else name + ' …' if own else name})"
