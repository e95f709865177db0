"""What conditions say of numbers: whether some can hold together, and their limits of a fluent."""

from __future__ import annotations

import operator as op
from collections.abc import Hashable, Iterable, Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

from serp.model import ground_model as g
from serp.model.ground_model import Linear, linear
from serp.pddl.source import Place

Pair = tuple[g.Test, g.Test]
_Limit = tuple[str, Fraction | int]
"""A comparison with a number: the operator and the number."""
_Tightest = dict[str, tuple[Fraction | int, g.Test]]
"""Operator, but for `!=` → the number that says most, and the test that says it."""
_Excepted = dict[Fraction | int, g.Test]
"""Number that a test excepts → that test."""
_HOLDS = {"<": op.lt, "<=": op.le, "=": op.eq, "!=": op.ne, ">=": op.ge, ">": op.gt}
_MIRRORED = {"<": ">", "<=": ">=", "=": "=", ">=": "<=", ">": "<"}
_NEGATED = {"<": ">=", "<=": ">", ">=": "<", ">": "<="}
_RANGES: dict[str, tuple[_Limit, ...]] = {
    **dict.fromkeys(("sqrt", "abs"), ((">=", 0),)),
    **dict.fromkeys(("sin", "cos"), ((">=", -1), ("<=", 1))),
    "atan2": ((">=", Fraction("-3.1416")), ("<=", Fraction("3.1416"))),
}
"""What functions cannot leave; π is rounded up."""


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
        if len(alternatives.operands) <= 32:
            pairs = [known.copy().add(operand, []) for operand in alternatives.operands]
            if all(pairs):
                return next((p for p in pairs if p and p[0] != p[1]), pairs[0])
    return None


class Limit(NamedTuple):
    """A fluent, and a number that a condition compares it with."""

    fluent: int
    number: float
    place: Place


def limits_in(ground: g.GroundModel, theta: Sequence[float]) -> Iterator[Limit]:
    """Yield the limits that the conditions of a domain put to single fluents."""
    for schema in ground.schemas:
        for comparison in g.comparisons_of(schema.preconditions, schema.effects):
            form = _difference(comparison, theta)
            atom, factor = next(iter(form.terms.items()), (None, Fraction(0)))
            if len(form.terms) == 1 and isinstance(atom, int):
                yield Limit(atom, float(-form.constant / factor), comparison.place)


def _exclude(one: _Limit, other: _Limit) -> bool:
    """Whether no number satisfies both."""
    low, high = sorted((one[1], other[1]))
    tried = (low - 1, low, Fraction(low + high) / 2, high, high + 1)
    return not any(
        _HOLDS[one[0]](number, one[1]) and _HOLDS[other[0]](number, other[1]) for number in tried
    )


class _Known:
    """What a conjunction implies for predicates and expressions."""

    def __init__(self, theta: Sequence[float]) -> None:
        self.theta = theta
        self.truths: dict[int, tuple[bool, g.Test]] = {}
        self.limits: dict[Hashable, tuple[_Tightest, _Excepted]] = {}  # by expression

    def copy(self) -> _Known:
        other = _Known(self.theta)
        other.truths = dict(self.truths)
        other.limits = {key: (dict(a), dict(b)) for key, (a, b) in self.limits.items()}
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
        limit = (operator, -form.constant / factor)
        ranges = _RANGES.get(first[0], ()) if len(key) == 1 and isinstance(first, tuple) else ()
        if any(_exclude(limit, bound) for bound in ranges):
            return written, written
        known, excepted = self.limits.setdefault(key, ({}, {}))
        for other, (number, source) in known.items():
            if _exclude(limit, (other, number)):
                return source, written
        if operator == "=" and limit[1] in excepted:
            return excepted[limit[1]], written
        if operator == "!=":
            excepted.setdefault(limit[1], written)
        elif operator not in known or _HOLDS[operator](limit[1], known[operator][0]):
            known[operator] = limit[1], written
        return None


def _difference(test: g.Compare, theta: Sequence[float]) -> Linear:
    return linear(test.left, theta).plus(linear(test.right, theta), Fraction(-1))
