"""What conditions say of numbers: whether some can hold together, and their limits of a fluent."""

from __future__ import annotations

import math
import operator as op
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from serp.model import ground as g
from serp.model.ground import Linear, linear

Pair = tuple[g.Test, g.Test]
_HOLDS = {"<": op.lt, "<=": op.le, "=": op.eq, "!=": op.ne, ">=": op.ge, ">": op.gt}
_MIRRORED = {"<": ">", "<=": ">=", "=": "=", ">=": "<=", ">": "<"}
_NEGATED = {"<": ">=", "<=": ">", ">=": "<", ">": "<="}
_RANGES = {
    **dict.fromkeys(("sqrt", "abs"), (0.0, math.inf)),
    **dict.fromkeys(("sin", "cos"), (-1.0, 1.0)),
    "atan2": (-3.1416, 3.1416),
}
"""What functions cannot leave; π is rounded up."""
_MOST_ALTERNATIVES = 32
"""Alternatives of a disjunction that are tried."""


def contradiction(tests: Iterable[g.Test], theta: Sequence[float]) -> Pair | None:
    """Return two tests that cannot hold together, or None where none are found.

    Both are the same where one test contradicts itself.
    """
    known = _Known(theta)
    later: list[g.AnyOf] = []
    for test in tests:
        if pair := known.add(test, later):
            return pair
    for alternatives in later:
        if len(alternatives.operands) <= _MOST_ALTERNATIVES:
            pairs = [known.copy().add(operand, []) for operand in alternatives.operands]
            if all(pairs):
                return next((p for p in pairs if p and p[0] != p[1]), pairs[0])
    return None


def threshold(test: g.Compare, theta: Sequence[float]) -> tuple[int, str, float] | None:
    """Return fluent, operator and number of a comparison that puts a limit to one fluent.

    The operator is the one between them in this order. None for any other comparison.
    """
    form = _difference(test, theta)
    if len(form.terms) == 1:
        ((atom, factor),) = form.terms.items()
        if isinstance(atom, int):
            operator = test.operator if factor > 0 else _MIRRORED[test.operator]
            return atom, operator, float(-form.constant / factor)
    return None


@dataclass
class _Bounds:
    """The bounds of an expression, with the tests that they come from."""

    low: tuple[Fraction | float, bool, g.Test] | None = None  # value, whether strict, test
    high: tuple[Fraction | float, bool, g.Test] | None = None
    excluded: dict[Fraction | float, g.Test] = field(default_factory=dict)

    def add(self, operator: str, value: Fraction | float, test: g.Test) -> Pair | None:
        if operator == "!=":
            self.excluded[value] = test
        if operator in (">", ">=", "="):
            new = (value, operator == ">", test)
            if self.low is None or new[:2] > self.low[:2]:
                self.low = new
        if operator in ("<", "<=", "="):
            new = (value, operator == "<", test)
            if self.high is None or (-value, new[1]) > (-self.high[0], self.high[1]):
                self.high = new
        if self.low is None or self.high is None:
            return None
        if self.low[0] > self.high[0]:
            return self.low[2], self.high[2]
        if self.low[0] == self.high[0]:
            if self.low[1] or self.high[1]:
                return self.low[2], self.high[2]
            if self.low[0] in self.excluded:
                return self.low[2], self.excluded[self.low[0]]
        return None


class _Known:
    """What a conjunction implies for predicates and expressions."""

    def __init__(self, theta: Sequence[float]) -> None:
        self.theta = theta
        self.truths: dict[int, tuple[bool, g.Test]] = {}
        self.bounds: dict[Hashable, _Bounds] = {}

    def copy(self) -> _Known:
        other = _Known(self.theta)
        other.truths = dict(self.truths)
        other.bounds = {
            key: _Bounds(b.low, b.high, dict(b.excluded)) for key, b in self.bounds.items()
        }
        return other

    def add(
        self,
        test: g.Test,
        later: list[g.AnyOf],
        *,
        holds: bool = True,
        written: g.Test | None = None,
    ) -> Pair | None:
        """Add a test, or its negation; return what excludes each other.

        `later` takes the disjunctions; `written` is the test as the file has it.
        """
        written = test if written is None else written
        match test:
            case g.Constant(value):
                return (written, written) if value != holds else None
            case g.Not(operand):
                return self.add(operand, later, holds=not holds, written=written)
            case g.Holds(fluent):
                known = self.truths.setdefault(fluent, (holds, written))
                return (known[1], written) if known[0] != holds else None
            case g.Compare():
                return self._compare(test, written, holds=holds)
            case g.All(operands) | g.AnyOf(operands) if isinstance(test, g.All) == holds:
                pairs = (self.add(operand, later, holds=holds) for operand in operands)
                return next((pair for pair in pairs if pair), None)
            case g.All(operands) | g.AnyOf(operands):
                if not holds:
                    operands = tuple(g.Not(operand, test.place) for operand in operands)
                later.append(g.AnyOf(operands, test.place))
                return None

    def _compare(self, test: g.Compare, written: g.Test, *, holds: bool) -> Pair | None:
        operator = test.operator if holds else _NEGATED.get(test.operator, "!=")
        form = _difference(test, self.theta)
        if not form.terms:
            return None if _HOLDS[operator](form.constant, 0) else (written, written)
        first = min(form.terms, key=repr)
        factor = form.terms[first]
        key = frozenset((atom, k / factor) for atom, k in form.terms.items())
        if factor < 0:
            operator = _MIRRORED.get(operator, operator)
        value = -form.constant / factor
        if len(key) == 1 and isinstance(first, tuple) and first[0] in _RANGES:
            reachable = _Bounds()
            for end, bound in zip((">=", "<="), _RANGES[first[0]], strict=True):
                reachable.add(end, bound, written)
            if reachable.add(operator, value, written):
                return written, written
        return self.bounds.setdefault(key, _Bounds()).add(operator, value, written)


def _difference(test: g.Compare, theta: Sequence[float]) -> Linear:
    return linear(test.left, theta).plus(linear(test.right, theta), Fraction(-1))
