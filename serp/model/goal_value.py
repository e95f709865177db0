"""The reward for reaching the goal, in a problem with a metric.

The reward of a step is the gain of the metric. Reaching the goal is worth more than the metric can
gain in 100 steps, which is the sum of a constant reward under a discount of 0.99 (the bound that
R-max uses for unknown states; Brafman & Tennenholtz, 2002). The gain of the metric in one step is
bounded by the numbers of the files.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from serp.model import ground as g
from serp.pddl.syntax import Change

STEPS = 100
UNBOUNDED = 1_000_000.0
"""The reward for reaching the goal where the gain of the metric is not bounded."""

_Interval = tuple[float, float]
_ANY: _Interval = (-math.inf, math.inf)
_ELAPSED = -1
_SIGNS = {Change.INCREASE: 1.0, Change.DECREASE: -1.0}


@dataclass(frozen=True)
class GoalValue:
    """The reward for reaching the goal, as a function of the parameters.

    Attributes:
        parameter: The entry of θ that holds it.
        metric: The metric.
        actions, processes, events: The effects of each on the fluents that the metric reads;
            duplicates among actions are left out.
    """

    parameter: int
    metric: g.GroundMetric
    actions: tuple[tuple[g.SetNumber, ...], ...]
    processes: tuple[tuple[g.SetNumber, ...], ...]
    events: tuple[tuple[g.SetNumber, ...], ...]

    def bounded(self, theta: Sequence[float], dt: float) -> bool:
        """Whether the gain of the metric in a step is bounded."""
        return math.isfinite(self._range(theta, dt))

    def value(self, theta: Sequence[float], dt: float) -> float:
        """Return the reward for given parameters and a control period."""
        worth = 1.0 + STEPS * self._range(theta, dt)
        return worth if math.isfinite(worth) else UNBOUNDED

    def _range(self, theta: Sequence[float], dt: float) -> float:
        weights = _weights(self.metric.value, theta)
        if weights is None:
            return math.inf
        elapsed = weights.pop(_ELAPSED, 0.0) * dt
        low, high = min(elapsed, 0.0), max(elapsed, 0.0)
        steps = [_change(effects, weights, theta) for effects in self.actions]
        low += min((a for a, _ in steps), default=0.0)
        high += max((b for _, b in steps), default=0.0)
        for times, schemas in ((dt, self.processes), (1.0, self.events)):
            for effects in schemas:
                a, b = _change(effects, weights, theta)
                low += times * a
                high += times * b
        return high - low


def goal_value_of(
    parameter: int,
    metric: g.GroundMetric,
    actions: Iterable[g.GroundSchema],
    processes: Iterable[g.GroundSchema],
    events: Iterable[g.GroundSchema],
) -> GoalValue:
    """Return the reward for reaching the goal, in a problem with a metric.

    Args:
        parameter: The entry of θ that is to hold it.
        metric: The metric.
        actions: All ground actions.
        processes: All ground processes.
        events: All ground events.
    """
    read = set(g.fluents_of(metric.value))

    def relevant(schemas: Iterable[g.GroundSchema]) -> list[tuple[g.SetNumber, ...]]:
        found = (
            tuple(e for e in s.effects if isinstance(e, g.SetNumber) and e.target in read)
            for s in schemas
        )
        return [effects for effects in found if effects]

    return GoalValue(
        parameter,
        metric,
        tuple(dict.fromkeys(relevant(actions))),
        tuple(relevant(processes)),
        tuple(relevant(events)),
    )


def _change(
    effects: Iterable[g.SetNumber], weights: dict[int, float], theta: Sequence[float]
) -> _Interval:
    """Bound the change of the metric by effects that may or may not be applied."""
    low = high = 0.0
    for effect in effects:
        sign = _SIGNS.get(effect.change)
        if sign is None:
            return _ANY
        factor = sign * weights[effect.target]
        a, b = _product((factor, factor), _bounds(effect.value, theta))
        low, high = low + min(a, 0.0), high + max(b, 0.0)
    return low, high


def _weights(value: g.Value, theta: Sequence[float]) -> dict[int, float] | None:
    """Return the factor of each fluent in a linear expression; None where it is not linear."""
    match value:
        case g.Read(fluent):
            return {fluent: 1.0}
        case g.Elapsed():
            return {_ELAPSED: 1.0}
        case g.ParameterRef():
            return {}
        case g.Negation(operand):
            return _sum({}, _weights(operand, theta), -1.0)
        case g.Operation("+" | "-" as operator, left, right):
            sign = 1.0 if operator == "+" else -1.0
            return _sum(_weights(left, theta), _weights(right, theta), sign)
        case g.Operation(operator, left, right):
            constant, other = (right, left) if operator == "/" else (left, right)
            if _variable(constant):
                constant, other = other, constant
            if _variable(constant) or (operator == "/" and constant is left):
                return None
            factor = _bounds(constant, theta)[0]
            if operator == "/":
                factor = 1.0 / factor if factor else math.inf
            return _sum({}, _weights(other, theta), factor)


def _variable(value: g.Value) -> bool:
    match value:
        case g.Read() | g.Elapsed():
            return True
        case g.ParameterRef():
            return False
        case g.Negation(operand):
            return _variable(operand)
        case g.Operation(_, left, right):
            return _variable(left) or _variable(right)


def _sum(
    left: dict[int, float] | None, right: dict[int, float] | None, factor: float
) -> dict[int, float] | None:
    if left is None or right is None:
        return None
    return {
        f: left.get(f, 0.0) + factor * right.get(f, 0.0) for f in dict.fromkeys((*left, *right))
    }


def _bounds(value: g.Value, theta: Sequence[float]) -> _Interval:
    """Return an interval that contains the value for all values of the fluents."""
    match value:
        case g.ParameterRef(parameter):
            return theta[parameter], theta[parameter]
        case g.Negation(operand):
            low, high = _bounds(operand, theta)
            return -high, -low
        case g.Operation(operator, left, right):
            a, b = _bounds(left, theta), _bounds(right, theta)
            if operator == "+":
                return a[0] + b[0], a[1] + b[1]
            if operator == "-":
                return a[0] - b[1], a[1] - b[0]
            if operator == "*":
                return _product(a, b)
            if b[0] <= 0.0 <= b[1]:
                return _ANY
            return _product(a, (1.0 / b[1], 1.0 / b[0]))
        case _:
            return _ANY


def _product(a: _Interval, b: _Interval) -> _Interval:
    ends = [x * y if x and y else 0.0 for x in a for y in b]
    return min(ends), max(ends)
