"""Parsing conditions, with names and types checked in place."""

from __future__ import annotations

from serp.pddl import slips
from serp.pddl import syntax as x
from serp.pddl.declarations import expect_group, parse_parameters
from serp.pddl.expressions import as_function, is_number, parse_expression
from serp.pddl.scope import INSTEAD, Scope, declared_as, parse_arguments, parse_term
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError

_COMPARATORS = ("<", "<=", "=", ">=", ">")


def parse_condition(node: Node, scope: Scope) -> x.Condition | None:
    """Parse a condition; None for the empty `()`."""
    if slip := slips.bare(node, "a condition", scope.declarations):
        raise slip
    group = expect_group(node, "a condition")
    if not group.items:
        return None
    head = group.head
    if slip := slips.in_condition(group, scope.declarations):
        raise slip
    if head in ("and", "or", "not", "imply"):
        return _connective(group, scope)
    if head in ("forall", "exists"):
        parameters, body = parse_quantifier(group, scope)
        inner = scope.bind(parameters)
        return x.Quantified(head, parameters, required_condition(body, inner), group.place)
    if head in _COMPARATORS:
        return _comparison(group, scope)
    if head == "preference":
        raise DomainError(
            "preferences are not supported", group.place, INSTEAD["preference"], code="unsupported"
        )
    if head in ("at", "over") and head not in scope.declarations and _is_timed(group):
        raise DomainError(
            "timed conditions (durative actions) are not supported",
            group.place,
            INSTEAD[head],
            code="unsupported",
        )
    declaration = declared_as(group, scope, numeric=False)
    return x.Atom(declaration.name, parse_arguments(group, declaration, scope), group.place)


def _is_timed(group: Group) -> bool:
    """Whether a form is `(at start ...)`, `(at end ...)`, `(over all ...)` or `(at 5 ...)`."""
    when = group.items[1] if len(group.items) == 3 else None
    return isinstance(when, Word) and (when.text in ("start", "end", "all") or is_number(when))


def required_condition(node: Node, scope: Scope) -> x.Condition:
    """Parse a condition that an operator needs: `()` is the empty conjunction."""
    condition = parse_condition(node, scope)
    return condition if condition is not None else x.Connective("and", (), node.place)


def _connective(group: Group, scope: Scope) -> x.Connective:
    operands: list[x.Condition] = []
    for item in group.items[1:]:
        with item.place.source.recovering():
            operands.append(required_condition(item, scope))
    wanted = {"not": 1, "imply": 2}.get(group.head)
    if wanted is not None and len(group.items) - 1 != wanted:
        raise DomainError(
            f"`{group.head}` takes {wanted} condition{'s' if wanted > 1 else ''}, "
            f"found {len(group.items) - 1}",
            group.place,
        )
    return x.Connective(group.head, tuple(operands), group.place)


def parse_quantifier(group: Group, scope: Scope) -> tuple[tuple[x.SchemaParameter, ...], Node]:
    """Return the variables and the body of `(forall (?x - type) body)`, or of `exists`."""
    if len(group.items) != 3:
        problem = f"`{group.head}` takes a list of variables and one body"
        if len(group.items) > 3 and isinstance(group.items[1], Group):
            raise slips.several_after(group, 2, problem)
        raise DomainError(problem, group.place, f"write `({group.head} (?x - type) ...)`")
    variables = expect_group(group.items[1], "a list of variables")
    return parse_parameters(variables.items, dict(scope.parents)), group.items[2]


def _comparison(group: Group, scope: Scope) -> x.Condition:
    if len(group.items) != 3:
        raise slips.not_two(group, f"`{group.head}` compares two things")
    left, right = (as_function(node, scope) for node in group.items[1:])
    if group.head == "=" and not any(isinstance(n, Group) or is_number(n) for n in (left, right)):
        return x.SameObject(parse_term(left, scope), parse_term(right, scope), group.place)
    return x.NumericComparison(
        group.head, parse_expression(left, scope), parse_expression(right, scope), group.place
    )
