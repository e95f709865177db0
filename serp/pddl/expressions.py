"""Parsing numeric expressions, with names and types checked in place."""

from __future__ import annotations

import re

from serp.pddl import slips
from serp.pddl import syntax as x
from serp.pddl.declarations import TOTAL_TIME, without_parentheses
from serp.pddl.scope import Scope, declared_as, parse_arguments
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?\Z", re.ASCII)
_MAX_CHAIN = 100
_OPERANDS: dict[tuple[int, int | None], str] = {
    (1, 1): "one operand",
    (1, 2): "one or two operands",
    (2, 2): "two operands",
    (2, None): "two or more operands",
}


def is_number(node: Node) -> bool:
    """Whether the node is a numeric literal."""
    return isinstance(node, Word) and _NUMBER.match(node.text) is not None


def parse_number(node: Node) -> x.Number:
    """Parse a numeric literal."""
    if isinstance(node, Word) and (slip := slips.in_word(node)):
        raise slip
    if not isinstance(node, Word) or not _NUMBER.match(node.text):
        shown = node.text if isinstance(node, Word) else node.place.text
        raise DomainError(f"expected a number, found `{shown}`", node.place, code="bad-number")
    value = float(node.text)
    if value in (float("inf"), float("-inf")):
        raise DomainError(f"`{node.text}` is too large a number", node.place, code="bad-number")
    return x.Number(value, node.place)


def as_function(node: Node, scope: Scope) -> Node:
    """Return a node, with parentheses where it is the bare name of a function without arguments."""
    if not isinstance(node, Word) or node.text in scope.objects:
        return node
    declaration = scope.declarations.get(node.text)
    known = (
        node.text == TOTAL_TIME
        if declaration is None
        else (declaration.numeric and not declaration.parameters)
    )
    return without_parentheses(node) if known else node


def parse_expression(node: Node, scope: Scope) -> x.Expression:
    """Parse a numeric expression."""
    node = as_function(node, scope)
    if isinstance(node, Word):
        if is_number(node):
            return parse_number(node)
        if node.text == "#t":
            raise DomainError(
                "`#t` may stand only as a factor of a rate in a process",
                node.place,
                "write `(increase (f) (* #t rate))` inside a `(:process ...)`",
                code="process-effect",
            )
        if slip := slips.in_word(node):
            raise slip
        code = "bad-number" if node.text[0] in "+-.0123456789" else "malformed"
        problem = f"expected a number or `(...)`, found `{node.text}`"
        raise DomainError(problem, node.place, code=code)
    if scope.calculates(node.head):
        return _arithmetic(node, scope)
    if node.head == TOTAL_TIME:
        if not scope.in_metric or len(node.items) != 1:
            raise DomainError("`(total-time)` may stand only in a metric", node.place)
        return x.TotalTime(node.place)
    if slip := slips.in_number(node, scope.declarations):
        raise slip
    declaration = declared_as(node, scope, numeric=True)
    if declaration.name == x.REWARD and not scope.in_metric:
        raise DomainError(
            "`(reward)` cannot be read; it is only ever increased or decreased",
            node.place,
            code="reserved-use",
        )
    return x.FunctionTerm(declaration.name, parse_arguments(node, declaration, scope), node.place)


def _arithmetic(group: Group, scope: Scope) -> x.Arithmetic:
    operator = group.head
    if operator in x.MATH_FUNCTIONS and not scope.math:
        raise DomainError(
            f"`{operator}` is not PDDL: it needs the requirement `{x.MATH_REQUIREMENT}`",
            group.items[0].place,
            f"list `{x.MATH_REQUIREMENT}` under :requirements, then this is a file for SErP alone; "
            f"for a portable one {slips.PORTABLE[operator]}",
            code="math-functions",
        )
    operands = tuple(parse_expression(item, scope) for item in group.items[1:])
    least, most = x.OPERATORS[operator]
    if len(operands) < least or (most is not None and len(operands) > most):
        raise DomainError(
            f"`{operator}` takes {_OPERANDS[least, most]}, found {len(operands)}", group.place
        )
    last = operands[-1]
    if isinstance(last, x.Number):
        if operator == "/" and last.value == 0.0:
            raise DomainError(
                "a division by zero", last.place, "it never has a result", code="no-result"
            )
        if operator == "sqrt" and last.value < 0.0:
            raise DomainError(
                "a root of a negative number", last.place, "it never has a result", code="no-result"
            )
    return _no_long_chain(x.Arithmetic(operator, operands, group.place))


def _no_long_chain(expression: x.Arithmetic) -> x.Arithmetic:
    if _chain(expression) > _MAX_CHAIN:
        raise DomainError(
            f"an expression of more than {_MAX_CHAIN} operations in a row",
            expression.place,
            "give a part of it a function of its own",
            code="too-large",
        )
    return expression


def _chain(expression: x.Expression) -> int:
    """Return how many operations wait for one another at most (operands are taken in pairs)."""
    if not isinstance(expression, x.Arithmetic):
        return 0
    return max(map(_chain, expression.operands)) + max(1, len(expression.operands) - 1)
