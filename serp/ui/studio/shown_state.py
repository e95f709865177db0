"""The state that a decision is shown for: values by name, so that it outlives edits of the file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from serp.authoring.lint.conditions import threshold
from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector

_MARGIN = 0.25
"""What a range has beyond what was seen, as a share of its width."""


@dataclass(frozen=True)
class ShownState:
    """A state by name.

    Attributes:
        values: Fluent → value, of some or all fluents.
        origin: Where they come from, for people.
    """

    values: Mapping[str, float | bool] = field(default_factory=dict)
    origin: str = ""

    def state(self, model: TransitionModel) -> Vector:
        """Return the state `[F]` of a model.

        A fluent without a value has its initial one, or else 0 (false); names that the model does
        not have, or values that it cannot take, are left out.
        """
        state = np.zeros(len(model.fluents)) if model.initial_state is None else np.array(
            model.initial_state
        )  # fmt: skip
        for fluent in model.fluents:
            value = float(self.values.get(fluent.name, math.nan))
            if math.isfinite(value):
                state[fluent.index] = value if fluent.numeric else float(value != 0.0)
        return state

    def changed(self, name: str, value: float | bool) -> ShownState:
        """Return the same situation with another value of one fluent."""
        return ShownState({**self.values, name: value}, self.origin)


@dataclass(frozen=True)
class Control:
    """A fluent as it can be set.

    Attributes:
        name: The fluent.
        numeric: Whether it is a number; else it is true or false.
        value: Its value in the state that is shown.
        low, high: Range of a slider.
        step: Its step.
    """

    name: str
    numeric: bool
    value: float
    low: float = 0.0
    high: float = 1.0
    step: float = 1.0


def controls(
    model: TransitionModel, state: Vector, seen: Mapping[str, tuple[float, float]]
) -> list[Control]:
    """Return how each fluent can be set.

    The range of a number covers what was `seen` of it (name → least, greatest) and the numbers that
    conditions of the file compare it with, and a bit more.
    """
    compared = thresholds(model)
    found = []
    for fluent in model.fluents:
        value = float(state[fluent.index])
        if not fluent.numeric:
            found.append(Control(fluent.name, False, value))
            continue
        limits = _range(compared.get(fluent.index, ()), seen.get(fluent.name, ()), value)
        found.append(Control(fluent.name, True, value, *limits))
    return found


def thresholds(model: TransitionModel) -> dict[int, list[float]]:
    """Return the numbers that conditions compare each fluent with: index → numbers."""
    theta = model.theta.tolist()
    found: dict[int, list[float]] = {}
    for schema in model.ground.schemas:
        conditions = [*schema.preconditions, *(effect.condition for effect in schema.effects)]
        for test in (c for condition in conditions for c in g.comparisons_of(condition)):
            if (limit := threshold(test, theta)) is not None:
                fluent, _, number = limit
                if math.isfinite(number):
                    found.setdefault(fluent, []).append(number)
    return found


def _range(
    compared: Sequence[float], seen: Sequence[float], value: float
) -> tuple[float, float, float]:
    """Return low, high and step."""
    numbers = (*compared, *seen, value)
    low, high = min(0.0, *numbers), max(numbers)
    if seen and high - low >= 2 and all(number.is_integer() for number in numbers):
        return low, high, 1.0
    if low == high:  # nothing is known of it
        high = 1.0
    outer = _MARGIN * (high - low)
    step = nice((high - low) / 200)
    low -= outer if low < 0 else 0.0
    return (
        _round(math.floor(low / step), step),
        _round(math.ceil((high + outer) / step), step),
        step,
    )


def _round(steps: int, step: float) -> float:
    return float(f"{steps * step:.12g}")


def nice(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, near a positive number."""
    if not value > 0 or not math.isfinite(value):
        return 0.01
    power = 10.0 ** math.floor(math.log10(value))
    return next((m * power for m in (1.0, 2.0, 5.0) if m * power >= value), 10 * power)
