"""Canonical forms of conditions, values and effects: those that mean the same have equal forms.

The order of conjuncts, effects and operands does not count, and `(> b a)` is `(< a b)`. Floats
are then added and multiplied in another order, so the same means equal up to rounding.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator

from serp.model import ground as g


class Canonical:
    """Canonical forms of one model's expressions, with the fluents in other columns.

    Args:
        theta: The values of the parameters; those that are equal are not told apart.
        column: The column that stands for each column.
    """

    def __init__(self, theta: list[float], column: Callable[[int], int]) -> None:
        self.theta = theta
        self.column = column

    def schema(self, schema: g.GroundSchema) -> Hashable:
        """Return the form of an action, process or event, whatever its name."""
        tests = frozenset(self.test(test) for test in schema.preconditions)
        return schema.kind, tests, _bag(self._effect(effect) for effect in schema.effects)

    def _effect(self, effect: g.GroundEffect) -> Hashable:
        target, condition = self._fluent(effect.target), self.test(effect.condition)
        if isinstance(effect, g.SetBoolean):
            return target, effect.value, condition
        return target, effect.change, self.value(effect.value), condition

    def _fluent(self, fluent: int) -> int:
        return fluent if fluent < 0 else self.column(fluent)

    def test(self, test: g.Test) -> Hashable:
        """Return the form of a condition."""
        match test:
            case g.Constant(value):
                return value
            case g.Holds(fluent):
                return "holds", self._fluent(fluent)
            case g.Not(operand):
                return "not", self.test(operand)
            case g.Compare(operator, left, right):
                sides = self.value(left), self.value(right)
                if operator == "=":
                    return operator, _bag(sides)
                if operator[0] == ">":
                    return operator.replace(">", "<"), sides[::-1]
                return operator, sides
            case g.All(operands) | g.AnyOf(operands):
                return type(test), frozenset(self.test(operand) for operand in operands)

    def value(self, value: g.Value) -> Hashable:
        """Return the form of a numeric expression."""
        match value:
            case g.Read(fluent):
                return "read", self.column(fluent)
            case g.ParameterRef(parameter):
                return self.theta[parameter]
            case g.Elapsed():
                return "elapsed"
            case g.Negation(operand):
                return "negative", self.value(operand)
            case g.Operation("+" | "*" as operator):
                return operator, _bag(self.value(term) for term in _terms(value, operator))
            case g.Operation(operator, left, right):
                return operator, self.value(left), self.value(right)


def _bag(forms: Iterable[Hashable]) -> Hashable:
    return frozenset(Counter(forms).items())


def _terms(value: g.Value, operator: str) -> Iterator[g.Value]:
    """Yield the operands of a nested sum or product."""
    if isinstance(value, g.Operation) and value.operator == operator:
        yield from _terms(value.left, operator)
        yield from _terms(value.right, operator)
    else:
        yield value
