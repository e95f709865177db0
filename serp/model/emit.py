"""Building the syntax trees of conditions and numbers.

Conditions are three-valued (Kleene's strong logic). A comparison with a side that is not a number
(a division by zero, a difference of two overflows) is undefined, and so is every condition whose
truth depends on it. The step then has no result (`Emitter.truth`): an action must not count as safe
because NaN compares as false.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from serp.model import ground as g
from serp.model.flags import UNDEFINED, UNSAFE

FLAG_NAMES = {g.UNSAFE_TARGET: "unsafe", g.TERMINAL_TARGET: "terminal"}
_OPERATIONS: dict[str, ast.operator] = {"+": ast.Add(), "-": ast.Sub(), "*": ast.Mult()}
_COMPARISONS: dict[str, ast.cmpop] = {
    "<": ast.Lt(),
    "<=": ast.LtE(),
    "=": ast.Eq(),
    ">=": ast.GtE(),
    ">": ast.Gt(),
}
# Where every one of these is false, the comparison holds or a side is NaN.
_REFUTATIONS: dict[str, tuple[ast.cmpop, ...]] = {
    "<": (ast.GtE(),),
    "<=": (ast.Gt(),),
    "=": (ast.Lt(), ast.Gt()),
    ">=": (ast.Lt(),),
    ">": (ast.LtE(),),
}


@dataclass(frozen=True, slots=True)
class Site:
    """A place in the generated code that a traced run reports when it is reached.

    Attributes:
        what: `failed` (a precondition that does not hold), `effect` (of an action or event that
            was applied), `rate` (of a process that was applied), `conflict` (effects that
            contradict each other) or `undefined` (a result that is not a finite number, or a
            condition that is neither true nor false).
        schema: The ground action, process or event; None for the goal and the reward as a whole.
        item: The condition or effect; None where the schema as a whole is meant.
    """

    what: Literal["failed", "effect", "rate", "conflict", "undefined"]
    schema: g.GroundSchema | None
    item: g.Test | g.GroundEffect | None


def variable(identifier: str) -> ast.Name:
    """Return a variable that is read."""
    return ast.Name(identifier, ast.Load())


def constant(value: float | bool) -> ast.Constant:
    """Return a constant."""
    return ast.Constant(value)


def entry(array: str, index: int) -> ast.Subscript:
    """Return an entry of an array that is read."""
    return ast.Subscript(variable(array), ast.Constant(index), ast.Load())


def assign(identifier: str, value: ast.expr) -> ast.stmt:
    """Return an assignment to a variable."""
    return ast.Assign([ast.Name(identifier, ast.Store())], value)


def store(index: int, value: ast.expr) -> ast.stmt:
    """Return an assignment to an entry of `out`."""
    target = ast.Subscript(variable("out"), ast.Constant(index), ast.Store())
    return ast.Assign([target], value)


def negated(test: ast.expr) -> ast.expr:
    """Return `not test`."""
    return ast.UnaryOp(ast.Not(), test)


def joined(operator: ast.boolop, tests: Sequence[ast.expr]) -> ast.expr:
    """Return `test and test ...` or `test or test ...`; a single test is returned as it is."""
    return tests[0] if len(tests) == 1 else ast.BoolOp(operator, list(tests))


class Emitter:
    """Collects statements, and writes conditions and numbers as expressions over arrays."""

    def __init__(self, *, traced: bool) -> None:
        self.traced = traced
        self.sites: list[Site] = []
        self.body: list[ast.stmt] = []
        self._temporaries = 0
        self._sides: dict[int, tuple[ast.Name, ast.Name]] = {}

    # Statements --------------------------------------------------------------------------------

    def temporary(self, value: ast.expr) -> ast.Name:
        """Assign a value to a new variable and return it."""
        identifier = f"t{self._temporaries}"
        self._temporaries += 1
        self.body.append(assign(identifier, value))
        return variable(identifier)

    @contextmanager
    def collected(self) -> Iterator[list[ast.stmt]]:
        """Collect the statements emitted within the context in a separate list."""
        outer, self.body = self.body, []
        yield self.body
        self.body = outer

    @contextmanager
    def under(self, condition: ast.expr | None) -> Iterator[None]:
        """Put the statements emitted within the context under a condition; None: always true."""
        with self.collected() as statements:
            yield
        if condition is None:
            self.body += statements
        else:
            self.body.append(ast.If(condition, statements or [ast.Pass()], []))

    def report(self, site: Site) -> list[ast.stmt]:
        """Return the statements that report a site; none unless traced."""
        if not self.traced:
            return []
        self.sites.append(site)
        append = ast.Attribute(variable("trace"), "append", ast.Load())
        return [ast.Expr(ast.Call(append, [ast.Constant(len(self.sites) - 1)], []))]

    def refuse(self, test: ast.expr, site: Site) -> None:
        """Emit: where `test` is true, the step has no result.

        A failed precondition sets no flag. Everything else sets UNDEFINED, and UNSAFE where that is
        certain by then: a step that cannot be predicted must not count as safe.
        """
        result: ast.expr = ast.Constant(0)
        if site.what != "failed":
            known = ast.IfExp(variable("unsafe"), ast.Constant(UNSAFE), ast.Constant(0))
            result = ast.BinOp(ast.Constant(UNDEFINED), ast.BitOr(), known)
        self.body.append(ast.If(test, [*self.report(site), ast.Return(result)], []))

    def require_finite(self, value: ast.expr, site: Site) -> None:
        """Emit: where a value is NaN or infinite, the step has no result."""
        # x - x is 0 for every finite x, and NaN for the others.
        difference = ast.BinOp(value, ast.Sub(), value)
        self.refuse(ast.Compare(difference, [ast.NotEq()], [constant(0.0)]), site)

    # Conditions --------------------------------------------------------------------------------

    def truth(
        self,
        test: g.Test,
        source: str,
        schema: g.GroundSchema | None,
        unless: ast.expr | None = None,
    ) -> ast.expr:
        """Emit code that ends the step where a condition is undefined; return its truth value.

        Args:
            test: The condition.
            source: The array that it reads.
            schema: Where it is written.
            unless: Where this is true, the condition is irrelevant.
        """
        certain, doubt = self.decide(test, source, unless)
        if doubt is not None:
            self.refuse(doubt, Site("undefined", schema, test))
        return certain

    def decide(
        self, test: g.Test, source: str, unless: ast.expr | None = None
    ) -> tuple[ast.expr, ast.expr | None]:
        """Return whether a condition is true, and whether it is undefined (None: it never is)."""
        if not _may_be_undefined(test):
            return self._certain(test, source), None
        for comparison in g.comparisons_of(test):
            if _may_be_nan(comparison.left) or _may_be_nan(comparison.right):
                left, right = (
                    self.temporary(self.value(side, source))
                    for side in (comparison.left, comparison.right)
                )
                self._sides[id(comparison)] = left, right
        certain = self.temporary(self._certain(test, source))
        doubts = [self._possible(test, source), negated(certain)]
        if unless is not None:
            doubts.insert(0, negated(unless))
        self._sides.clear()
        return certain, joined(ast.And(), doubts)

    def _certain(self, test: g.Test, source: str) -> ast.expr:
        """Return whether a condition is certainly true: neither false nor undefined."""
        match test:
            case g.Constant(value):
                return constant(value)
            case g.Holds(fluent):
                if fluent in FLAG_NAMES:  # before the action, both are false
                    return constant(False) if source == "s" else variable(FLAG_NAMES[fluent])
                return ast.Compare(entry(source, fluent), [ast.NotEq()], [constant(0.0)])
            case g.Compare(operator):
                left, right = self._compared(test, source)
                return ast.Compare(left, [_COMPARISONS[operator]], [right])
            case g.Not(operand):
                return negated(self._possible(operand, source))
            case g.All(operands):
                return joined(ast.And(), [self._certain(o, source) for o in operands])
            case g.AnyOf(operands):
                return joined(ast.Or(), [self._certain(o, source) for o in operands])

    def _possible(self, test: g.Test, source: str) -> ast.expr:
        """Return whether a condition is possibly true: true or undefined."""
        match test:
            case g.Compare(operator) if id(test) in self._sides:
                left, right = self._sides[id(test)]
                refuted = [ast.Compare(left, [r], [right]) for r in _REFUTATIONS[operator]]
                return negated(joined(ast.Or(), refuted))
            case g.Not(operand):
                return negated(self._certain(operand, source))
            case g.All(operands):
                return joined(ast.And(), [self._possible(o, source) for o in operands])
            case g.AnyOf(operands):
                return joined(ast.Or(), [self._possible(o, source) for o in operands])
            case _:
                return self._certain(test, source)

    def _compared(self, test: g.Compare, source: str) -> tuple[ast.expr, ast.expr]:
        """Return both sides of a comparison, evaluated once where they may be NaN."""
        if id(test) in self._sides:
            return self._sides[id(test)]
        return self.value(test.left, source), self.value(test.right, source)

    # Numbers -----------------------------------------------------------------------------------

    def value(self, value: g.Value, source: str, elapsed: ast.expr | None = None) -> ast.expr:
        """Return a numeric expression over the array `source`; NaN where it divides by zero."""
        match value:
            case g.Read(fluent):
                return entry(source, fluent)
            case g.ParameterRef(parameter):
                return entry("theta", parameter)
            case g.Elapsed():
                return elapsed or variable("dt")
            case g.Negation(operand):
                return ast.UnaryOp(ast.USub(), self.value(operand, source, elapsed))
            case g.Operation(operator, left, right):
                operands = (
                    self.value(left, source, elapsed),
                    self.value(right, source, elapsed),
                )
                if operator == "/":
                    return self.quotient(*operands)
                return ast.BinOp(operands[0], _OPERATIONS[operator], operands[1])

    def quotient(self, dividend: ast.expr, divisor: ast.expr) -> ast.expr:
        """Divide without an exception: a division by zero gives NaN."""
        if not isinstance(divisor, ast.Name | ast.Subscript):
            divisor = self.temporary(divisor)
        nonzero = ast.Compare(divisor, [ast.NotEq()], [constant(0.0)])
        return ast.IfExp(nonzero, ast.BinOp(dividend, ast.Div(), divisor), constant(float("nan")))


def _may_be_undefined(test: g.Test) -> bool:
    return any(_may_be_nan(c.left) or _may_be_nan(c.right) for c in g.comparisons_of(test))


def _may_be_nan(value: g.Value) -> bool:
    """Whether an expression over finite numbers can be NaN.

    One sum or product of finite numbers can overflow. NaN arises only from an operation on an
    overflowed value, or from a division by zero.
    """
    match value:
        case g.Operation(operator, left, right):
            return operator == "/" or _may_overflow(left) or _may_overflow(right)
        case g.Negation(operand):
            return _may_be_nan(operand)
        case _:
            return False


def _may_overflow(value: g.Value) -> bool:
    while isinstance(value, g.Negation):
        value = value.operand
    return isinstance(value, g.Operation)
