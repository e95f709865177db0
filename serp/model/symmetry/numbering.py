"""Numbers for conditions, values and effects; equivalent ones have equal numbers.

The order of conjuncts, effects and operands does not count, and `(> b a)` is `(< a b)`. Floats
are then added and multiplied in another order, so equivalent means equal up to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator

from serp.model import ground as g

Seen = Callable[[int], int]
"""Column of a fluent → the number that stands for it."""


class GaveUp(Exception):
    """More expressions were visited than allowed."""


class Numbering:
    """Assigns one number to each key.

    Args:
        ground: The model that expressions are from.
        max_work: Most expressions that are visited; None: no limit.
    """

    def __init__(self, ground: g.GroundModel, max_work: int | None) -> None:
        self.theta = [p.value for p in ground.parameters]
        self.known: dict[Hashable, int] = {}
        self.left = max_work

    def count(self, amount: int = 1) -> None:
        """Count expressions that are visited.

        Raises:
            GaveUp: The limit is exceeded.
        """
        if self.left is not None:
            self.left -= amount
            if self.left < 0:
                raise GaveUp

    def number(self, *key: Hashable) -> int:
        """Return the number of a key."""
        self.count()
        return self.known.setdefault(key, len(self.known))

    def schema(self, schema: g.GroundSchema, seen: Seen) -> int:
        """Return the number of an action, process or event, whatever its name."""
        tests = sorted({self.test(test, seen) for test in schema.preconditions})
        effects = sorted(self._effect(effect, seen) for effect in schema.effects)
        return self.number(schema.kind, tuple(tests), tuple(effects))

    def _effect(self, effect: g.GroundEffect, seen: Seen) -> int:
        target = effect.target if effect.target < 0 else seen(effect.target)
        condition = self.test(effect.condition, seen)
        if isinstance(effect, g.SetBoolean):
            return self.number("set", target, effect.value, condition)
        return self.number(effect.change, target, self.value(effect.value, seen), condition)

    def test(self, test: g.Test, seen: Seen) -> int:
        """Return the number of a condition."""
        match test:
            case g.Constant(value):
                return self.number("constant", value)
            case g.Holds(fluent):
                return self.number("holds", fluent if fluent < 0 else seen(fluent))
            case g.Not(operand):
                return self.number("not", self.test(operand, seen))
            case g.Compare(operator, left, right):
                sides = [self.value(left, seen), self.value(right, seen)]
                if operator in (">", ">="):
                    operator = operator.replace(">", "<")
                    sides.reverse()
                elif operator == "=":
                    sides.sort()
                return self.number(operator, *sides)
            case g.All(operands) | g.AnyOf(operands):
                joined = sorted({self.test(operand, seen) for operand in operands})
                return self.number(type(test).__name__, tuple(joined))

    def value(self, value: g.Value, seen: Seen) -> int:
        """Return the number of a numeric expression."""
        match value:
            case g.Read(fluent):
                return self.number("read", seen(fluent))
            case g.ParameterRef(parameter):
                return self.number("parameter", self.theta[parameter])
            case g.Elapsed():
                return self.number("elapsed")
            case g.Negation(operand):
                return self.number("negative", self.value(operand, seen))
            case g.Operation(operator, left, right):
                if operator in "+*":
                    terms = sorted(self.value(v, seen) for v in _terms(value, operator))
                    return self.number(operator, tuple(terms))
                return self.number(operator, self.value(left, seen), self.value(right, seen))


def _terms(value: g.Value, operator: str) -> Iterator[g.Value]:
    """Yield the operands of a nested sum or product."""
    if isinstance(value, g.Operation) and value.operator == operator:
        yield from _terms(value.left, operator)
        yield from _terms(value.right, operator)
    else:
        yield value
