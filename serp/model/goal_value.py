"""The reward for reaching the goal, in a problem with a metric.

The reward of a step is the gain of the metric. Reaching the goal is worth more than the metric can
gain in 100 steps, which is the sum of a constant reward under a discount of 0.99 (the bound that
R-max uses for unknown states; Brafman & Tennenholtz, 2002). The gain of the metric in one step is
bounded by the numbers of the files.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction

from serp.model import ground as g
from serp.model.linear import ELAPSED, linear
from serp.pddl.syntax import Change

STEPS = 100
UNBOUNDED = 1_000_000.0
"""The reward for reaching the goal where the gain of the metric is not bounded."""

_SIGNS = {Change.INCREASE: 1.0, Change.DECREASE: -1.0}
_Effects = tuple[g.SetNumber, ...]


class GoalValue:
    """The reward for reaching the goal of a model with a metric, as a function of θ."""

    def __init__(self, ground: g.GroundModel) -> None:
        assert ground.metric is not None
        self.metric = ground.metric.value
        read = set(g.fluents_of(self.metric))

        def relevant(schemas: Iterable[g.GroundSchema]) -> list[_Effects]:
            numbers = (
                tuple(e for e in s.effects if isinstance(e, g.SetNumber) and e.target in read)
                for s in schemas
            )
            return [effects for effects in numbers if effects]

        self.actions = list(dict.fromkeys(relevant(ground.actions)))
        self.processes = relevant(ground.processes)
        self.events = relevant(ground.events)

    def bounded(self, theta: Sequence[float], dt: float) -> bool:
        """Whether the gain of the metric in a step is bounded."""
        return math.isfinite(self._range(theta, dt))

    def value(self, theta: Sequence[float], dt: float) -> float:
        """Return the reward for given parameters and a control period."""
        worth = 1.0 + STEPS * self._range(theta, dt)
        return worth if math.isfinite(worth) else UNBOUNDED

    def _range(self, theta: Sequence[float], dt: float) -> float:
        terms = linear(self.metric, theta).terms
        weights = {atom: _number(factor) for atom, factor in terms.items() if isinstance(atom, int)}
        elapsed = _number(terms.get(ELAPSED, Fraction(0))) * dt
        if len(weights) + (ELAPSED in terms) < len(terms):  # not linear
            return math.inf
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


def _change(
    effects: _Effects, weights: dict[int, float], theta: Sequence[float]
) -> tuple[float, float]:
    """Bound the change of the metric by effects that may or may not be applied."""
    low = high = 0.0
    for effect in effects:
        weight = weights.get(effect.target, 0.0)
        if not weight:
            continue
        sign, amount = _SIGNS.get(effect.change), _constant(effect.value, theta)
        if sign is None or amount is None:
            return -math.inf, math.inf
        change = sign * weight * amount
        low, high = low + min(change, 0.0), high + max(change, 0.0)
    return low, high


def _constant(value: g.Value, theta: Sequence[float]) -> float | None:
    """Return the value of an expression that reads no fluent; None for any other."""
    if isinstance(value, g.ParameterRef):
        return theta[value.parameter]
    form = linear(value, theta)
    return None if form.terms else _number(form.constant)


def _number(fraction: Fraction) -> float:
    try:
        return float(fraction)
    except OverflowError:
        return math.inf
