"""Numeric expressions as sums, exactly: `(- (x) (+ (y) 1))` is 1·x − 1·y − 1."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from serp.model import ground as g

FUNCTIONS: Mapping[str, Callable[..., float]] = {
    **{"sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "atan2": math.atan2},
    **{"abs": abs, "min": min, "max": max},
}
ELAPSED = "elapsed"
"""The atom of the control period."""


@dataclass(frozen=True)
class Linear:
    """A sum of atoms, each times a factor, and a constant.

    An atom is the column of a fluent, ELAPSED, or an operation that is not linear: a tuple of its
    operator and the keys of its operands.
    """

    terms: dict[Hashable, Fraction]
    constant: Fraction

    def plus(self, other: Linear, factor: Fraction) -> Linear:
        """Return this sum plus another one times a factor."""
        terms = dict(self.terms)
        for atom, k in other.terms.items():
            total = terms.get(atom, Fraction(0)) + k * factor
            if total:
                terms[atom] = total
            else:
                terms.pop(atom, None)
        return Linear(terms, self.constant + other.constant * factor)

    @property
    def key(self) -> Hashable:
        """Equal for equal sums."""
        return frozenset(self.terms.items()), self.constant


_NOTHING = Linear({}, Fraction(0))


def linear(value: g.Value, theta: Sequence[float]) -> Linear:
    """Return a numeric expression as a sum, for given parameters."""
    match value:
        case g.Read(fluent):
            return Linear({fluent: Fraction(1)}, Fraction(0))
        case g.ParameterRef(parameter):
            return Linear({}, Fraction(repr(float(theta[parameter]))))  # as it is written
        case g.Unary("-", operand):
            return _NOTHING.plus(linear(operand, theta), Fraction(-1))
        case g.Elapsed():
            return Linear({ELAPSED: Fraction(1)}, Fraction(0))
        case g.Unary(operator, operand):
            return _applied(operator, linear(operand, theta))
        case g.Operation(operator, left, right):
            one, other = linear(left, theta), linear(right, theta)
            if operator in FUNCTIONS:
                return _applied(operator, one, other)
            if operator in "+-":
                return one.plus(other, Fraction(1 if operator == "+" else -1))
            if not other.terms and (operator == "*" or other.constant):
                factor = other.constant
                return _NOTHING.plus(one, factor if operator == "*" else 1 / factor)
            if operator == "*" and not one.terms:
                return _NOTHING.plus(other, one.constant)
            return _applied(operator, one, other)


def _applied(operator: str, *operands: Linear) -> Linear:
    """Return an operation as one atom, or as its value where nothing varies."""
    if operator in FUNCTIONS and not any(operand.terms for operand in operands):
        try:
            value = FUNCTIONS[operator](*(float(operand.constant) for operand in operands))
            return Linear({}, Fraction(repr(value)))
        except (ValueError, OverflowError):  # it has no result
            pass
    return Linear({(operator, *(operand.key for operand in operands)): Fraction(1)}, Fraction(0))
