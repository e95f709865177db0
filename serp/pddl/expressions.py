"""Parsing conditions, numeric expressions and effects, with names and types checked in place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from serp._util.text import did_you_mean
from serp.pddl import slips
from serp.pddl.declarations import (
    TOTAL_TIME,
    expect_group,
    parse_parameters,
    without_parentheses,
)
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError, Place
from serp.pddl.syntax import (
    OBJECT,
    REWARD,
    TERMINAL,
    UNSAFE,
    Arithmetic,
    Atom,
    Change,
    ChangeFunction,
    Condition,
    Connective,
    Declaration,
    Effect,
    Expression,
    ForallEffect,
    FunctionTerm,
    Number,
    NumericComparison,
    ObjectDeclaration,
    Quantified,
    SameObject,
    SchemaParameter,
    SchemaTerm,
    SetPredicate,
    TotalTime,
    When,
)

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?\Z", re.ASCII)
_MAX_CHAIN = 100
_MAX_POWER = 8
_MAX_PRODUCT = 512
_COMPARATORS = ("<", "<=", "=", ">=", ">")
_OPERATORS = ("+", "-", "*", "/")
_CHANGES = {change.value: change for change in Change}
INSTEAD = {
    **dict.fromkeys(
        (":durative-action", "at", "over"),
        "write an action, and a process for what goes on meanwhile",
    ),
    **dict.fromkeys(
        (":derived", ":axiom"),
        "write the condition itself where it is used, or an event that sets the predicate",
    ),
    ":constraints": "write an event that sets `(unsafe)` where a constraint is broken",
    "preference": "write `(increase (reward) ...)` under a `when`, or as an event",
    "timed": "write a function as a clock, which a process increases, and an event",
    **dict.fromkeys((":method", ":task"), "write actions only; the planner chooses among them"),
}
"""What to write in the stead of PDDL that is not supported."""


@dataclass(frozen=True)
class Scope:
    """The names that an expression may use.

    Attributes:
        parents: Type → parent.
        objects: Objects and constants by name.
        declarations: Predicates and functions by name.
        parameters: Variables bound here.
        in_process: Whether effects are rates (`(* #t rate)`).
        in_metric: Whether `(total-time)` and `(reward)` may be read.
    """

    parents: Mapping[str, str]
    objects: Mapping[str, ObjectDeclaration]
    declarations: Mapping[str, Declaration]
    parameters: Mapping[str, SchemaParameter]
    in_process: bool = False
    in_metric: bool = False

    def bind(self, parameters: tuple[SchemaParameter, ...]) -> Scope:
        """Return the scope inside a quantifier or schema (inner names hide outer ones)."""
        return replace(self, parameters={**self.parameters, **{p.name: p for p in parameters}})

    def types_of(self, term: SchemaTerm) -> tuple[str, ...]:
        """Return the declared types of a term that is known to exist."""
        if term.is_variable:
            return self.parameters[term.name].types
        return (self.objects[term.name].type,)

    def is_a(self, type_name: str, ancestor: str) -> bool:
        """Whether a type is the ancestor or below it."""
        current = type_name
        while current not in (ancestor, OBJECT):
            current = self.parents[current]
        return current == ancestor


def parse_term(node: Node, scope: Scope) -> SchemaTerm:
    """Parse an argument.

    Raises:
        DomainError: The variable is not bound, or the object does not exist.
    """
    if not isinstance(node, Word):
        raise DomainError("expected a variable or an object, found a list", node.place)
    term = SchemaTerm(node.text, node.place)
    if term.is_variable:
        if term.name not in scope.parameters:
            raise DomainError(
                f"unknown variable `{term.name}`",
                node.place,
                did_you_mean(term.name, scope.parameters) or "no variable is bound here",
            )
    elif term.name not in scope.objects:
        raise DomainError(
            f"unknown object `{term.name}`",
            node.place,
            did_you_mean(term.name, scope.objects) or "declare it under :constants or :objects",
        )
    return term


def _arguments(group: Group, declaration: Declaration, scope: Scope) -> tuple[SchemaTerm, ...]:
    what = "function" if declaration.numeric else "predicate"
    terms = tuple(parse_term(node, scope) for node in group.items[1:])
    if len(terms) != len(declaration.parameters):
        raise DomainError(
            f"{what} `{declaration.name}` takes {len(declaration.parameters)} "
            f"argument{'' if len(declaration.parameters) == 1 else 's'}, found {len(terms)}",
            group.place,
            f"it is declared as {declaration.place.text}",
        )
    for term, parameter in zip(terms, declaration.parameters, strict=True):
        fits = all(
            any(scope.is_a(own, wanted) for wanted in parameter.types)
            for own in scope.types_of(term)
        )
        if not fits:
            raise DomainError(
                f"`{term.name}` is of type `{'/'.join(scope.types_of(term))}`, but "
                f"{what} `{declaration.name}` takes `{'/'.join(parameter.types)}` there",
                term.place,
            )
    return terms


def _declared(group: Group, scope: Scope, *, numeric: bool) -> Declaration:
    what = "function" if numeric else "predicate"
    word = group.items[0] if group.items else None
    if not isinstance(word, Word):
        raise DomainError(f"expected a {what}", group.place)
    declaration = scope.declarations.get(word.text)
    if declaration is None:
        names = [d.name for d in scope.declarations.values() if d.numeric == numeric]
        section = ":functions" if numeric else ":predicates"
        advice = did_you_mean(word.text, names)
        if word.text in (REWARD, UNSAFE, TERMINAL):
            advice = f"declare it: `({section} ... ({word.text}))`"
        raise DomainError(f"unknown {what} `{word.text}`", word.place, advice)
    if declaration.numeric != numeric:
        is_what, wanted = ("function", "predicate") if not numeric else ("predicate", "function")
        raise DomainError(f"`{word.text}` is a {is_what}, a {wanted} is needed here", word.place)
    return declaration


# Numeric expressions ---------------------------------------------------------------------------


def is_number(node: Node) -> bool:
    """Whether the node is a numeric literal."""
    return isinstance(node, Word) and _NUMBER.match(node.text) is not None


def parse_number(node: Node) -> Number:
    """Parse a numeric literal.

    Raises:
        DomainError: It is something else, or too large for a float64.
    """
    if isinstance(node, Word) and (slip := slips.decimal_comma(node)):
        raise slip
    if not isinstance(node, Word) or not _NUMBER.match(node.text):
        shown = node.text if isinstance(node, Word) else node.place.text
        raise DomainError(f"expected a number, found `{shown}`", node.place)
    value = float(node.text)
    if value in (float("inf"), float("-inf")):
        raise DomainError(f"`{node.text}` is too large a number", node.place)
    return Number(value, node.place)


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


def parse_expression(node: Node, scope: Scope) -> Expression:
    """Parse a numeric expression.

    Raises:
        DomainError: It is malformed or uses something unknown.
    """
    node = as_function(node, scope)
    if isinstance(node, Word):
        if is_number(node):
            return parse_number(node)
        if node.text == "#t":
            raise DomainError(
                "`#t` may stand only as a factor of a rate in a process",
                node.place,
                "write `(increase (f) (* #t rate))` inside a `(:process ...)`",
            )
        if slip := slips.decimal_comma(node):
            raise slip
        raise DomainError(f"expected a number or `(...)`, found `{node.text}`", node.place)
    if node.head in _OPERATORS:
        return _arithmetic(node, scope)
    if node.head == "^" and "^" not in scope.declarations:
        return _power(node, scope)
    if node.head == TOTAL_TIME:
        if not scope.in_metric or len(node.items) != 1:
            raise DomainError("`(total-time)` may stand only in a metric", node.place)
        return TotalTime(node.place)
    if slip := slips.in_number(node, scope.declarations):
        raise slip
    declaration = _declared(node, scope, numeric=True)
    if declaration.name == REWARD and not scope.in_metric:
        raise DomainError(
            "`(reward)` cannot be read; it is only ever increased or decreased", node.place
        )
    return FunctionTerm(declaration.name, _arguments(node, declaration, scope), node.place)


def _power(group: Group, scope: Scope) -> Expression:
    """Read `(^ x 2)` as `(* x x)`."""
    advice = f"the exponent is a whole number from 1 to {_MAX_POWER}: a product of so many factors"
    if len(group.items) != 3 or not is_number(group.items[2]):
        raise DomainError("`^` takes a number and a constant exponent", group.place, advice)
    exponent = parse_number(group.items[2])
    if exponent.value not in range(1, _MAX_POWER + 1):
        raise DomainError(f"`^` to the power of {exponent.value:g}", exponent.place, advice)
    group.place.warn(f"`{group.place.text}` is read as a product, which other tools may not do")
    base = parse_expression(group.items[1], scope)
    if exponent.value == 1:
        return base
    factors = (base,) * int(exponent.value)
    if len(factors) * _size(base) > _MAX_PRODUCT:  # powers of powers grow without bounds
        raise DomainError(
            f"a power that is a product of more than {_MAX_PRODUCT} numbers",
            group.place,
            "give a part of it a function of its own",
        )
    return _no_long_chain(Arithmetic("*", factors, group.place))


def _size(expression: Expression) -> int:
    """Return how many numbers and functions an expression is made of."""
    return sum(map(_size, expression.operands)) if isinstance(expression, Arithmetic) else 1


def _arithmetic(group: Group, scope: Scope) -> Arithmetic:
    operands = tuple(parse_expression(item, scope) for item in group.items[1:])
    operator = group.head
    least = 1 if operator == "-" else 2
    most = 2 if operator in "-/" else None
    if len(operands) < least or (most is not None and len(operands) > most):
        wanted = {"-": "one or two", "/": "two"}.get(operator, "two or more")
        raise DomainError(
            f"`{operator}` takes {wanted} operands, found {len(operands)}", group.place
        )
    divisor = operands[1] if operator == "/" else None
    if isinstance(divisor, Number) and divisor.value == 0.0:
        raise DomainError("a division by zero", divisor.place, "it never has a result")
    return _no_long_chain(Arithmetic(operator, operands, group.place))


def _no_long_chain(expression: Arithmetic) -> Arithmetic:
    if _chain(expression) > _MAX_CHAIN:
        raise DomainError(
            f"an expression of more than {_MAX_CHAIN} operations in a row",
            expression.place,
            "give a part of it a function of its own",
        )
    return expression


def _chain(expression: Expression) -> int:
    """Return how many operations wait for one another at most (operands are taken in pairs)."""
    if not isinstance(expression, Arithmetic):
        return 0
    return max(map(_chain, expression.operands)) + max(1, len(expression.operands) - 1)


# Conditions ------------------------------------------------------------------------------------


def parse_condition(node: Node, scope: Scope) -> Condition | None:
    """Parse a condition; None for the empty `()`.

    Raises:
        DomainError: It is malformed or uses something unknown.
    """
    group = expect_group(node, "a condition")
    if not group.items:
        return None
    head = group.head
    if slip := slips.in_condition(group, scope.declarations):
        raise slip
    if head in ("and", "or", "not", "imply"):
        return _connective(group, scope)
    if head in ("forall", "exists"):
        parameters, body = _quantifier(group, scope)
        inner = scope.bind(parameters)
        return Quantified(head, parameters, _required(body, inner), group.place)
    if head in _COMPARATORS:
        return _comparison(group, scope)
    if head == "preference":
        raise DomainError("preferences are not supported", group.place, INSTEAD["preference"])
    if head in ("at", "over") and head not in scope.declarations:
        raise DomainError(
            "timed conditions (durative actions) are not supported", group.place, INSTEAD[head]
        )
    declaration = _declared(group, scope, numeric=False)
    return Atom(declaration.name, _arguments(group, declaration, scope), group.place)


def _required(node: Node, scope: Scope) -> Condition:
    condition = parse_condition(node, scope)
    return condition if condition is not None else Connective("and", (), node.place)


def _connective(group: Group, scope: Scope) -> Connective:
    operands = tuple(_required(item, scope) for item in group.items[1:])
    wanted = {"not": 1, "imply": 2}.get(group.head)
    if wanted is not None and len(operands) != wanted:
        raise DomainError(
            f"`{group.head}` takes {wanted} condition{'s' if wanted > 1 else ''}, "
            f"found {len(operands)}",
            group.place,
        )
    return Connective(group.head, operands, group.place)


def _quantifier(group: Group, scope: Scope) -> tuple[tuple[SchemaParameter, ...], Node]:
    if len(group.items) != 3:
        problem = f"`{group.head}` takes a list of variables and one body"
        if len(group.items) > 3 and isinstance(group.items[1], Group):
            raise slips.several_after(group, 2, problem)
        raise DomainError(problem, group.place, f"write `({group.head} (?x - type) ...)`")
    variables = expect_group(group.items[1], "a list of variables")
    return parse_parameters(variables.items, dict(scope.parents)), group.items[2]


def _comparison(group: Group, scope: Scope) -> Condition:
    if len(group.items) != 3:
        raise DomainError(f"`{group.head}` compares two things", group.place)
    left, right = (as_function(node, scope) for node in group.items[1:])
    if group.head == "=" and not any(isinstance(n, Group) or is_number(n) for n in (left, right)):
        return SameObject(parse_term(left, scope), parse_term(right, scope), group.place)
    return NumericComparison(
        group.head, parse_expression(left, scope), parse_expression(right, scope), group.place
    )


# Effects ---------------------------------------------------------------------------------------


def parse_effects(node: Node, scope: Scope, *, inside_when: bool = False) -> tuple[Effect, ...]:
    """Parse an effect into its parts, with every `and` flattened.

    Raises:
        DomainError: It is malformed, nested `when`, or changes something that must not change.
    """
    group = expect_group(node, "an effect")
    if not group.items:
        return ()
    head = group.head
    if slip := slips.in_effect(group, scope.declarations):
        raise slip
    if head == "and":
        return tuple(
            effect
            for item in group.items[1:]
            for effect in parse_effects(item, scope, inside_when=inside_when)
        )
    if head == "forall":
        parameters, body = _quantifier(group, scope)
        inner = parse_effects(body, scope.bind(parameters), inside_when=inside_when)
        return (ForallEffect(parameters, inner, group.place),)
    if head == "when":
        return (_when(group, scope, inside_when=inside_when),)
    if head in _CHANGES:
        return (_change(group, scope),)
    if head == "not":
        if len(group.items) != 2:
            raise DomainError("`not` takes one predicate", group.place)
        return (_set_predicate(group.items[1], scope, value=False, place=group.place),)
    if head in ("or", "exists", "imply", "oneof", "probabilistic") and (
        head not in scope.declarations
    ):
        raise DomainError(
            f"`{head}` is not supported in an effect",
            group.place,
            "effects are deterministic: `and`, `forall`, `when`, predicates and numeric changes",
        )
    return (_set_predicate(group, scope, value=True, place=group.place),)


def _when(group: Group, scope: Scope, *, inside_when: bool) -> When:
    if inside_when:
        raise DomainError(
            "`when` inside `when` is not supported (other PDDL tools drop its outer condition)",
            group.place,
            "write one `when` with both conditions under `and`",
        )
    if scope.in_process:
        raise DomainError(
            "`when` is not supported in a process",
            group.place,
            "write the condition under :precondition, or write two processes",
        )
    if len(group.items) != 3:
        raise slips.several_after(group, 2, "`when` takes one condition and one effect")
    return When(
        _required(group.items[1], scope),
        parse_effects(group.items[2], scope, inside_when=True),
        group.place,
    )


def _set_predicate(node: Node, scope: Scope, *, value: bool, place: Place) -> SetPredicate:
    group = expect_group(node, "a predicate")
    if scope.in_process:
        raise DomainError(
            "a process only increases and decreases functions",
            place,
            "set predicates in an action or in an `(:event ...)`",
        )
    declaration = _declared(group, scope, numeric=False)
    if declaration.name in (UNSAFE, TERMINAL) and not value:
        raise DomainError(
            f"`({declaration.name})` can only be made true",
            place,
            "it starts afresh, false, in every step",
        )
    atom = Atom(declaration.name, _arguments(group, declaration, scope), group.place)
    return SetPredicate(atom, value, place)


def _change(group: Group, scope: Scope) -> ChangeFunction:
    if len(group.items) != 3:
        raise DomainError(f"`{group.head}` takes a function and a value", group.place)
    change = _CHANGES[group.head]
    target = expect_group(as_function(group.items[1], scope), "a function")
    declaration = _declared(target, scope, numeric=True)
    function = FunctionTerm(declaration.name, _arguments(target, declaration, scope), target.place)
    additive = change in (Change.INCREASE, Change.DECREASE)
    if declaration.name == REWARD and not additive:
        raise DomainError(
            f"`(reward)` may only be increased or decreased, not `{group.head}`", group.place
        )
    if scope.in_process:
        if not additive:
            raise DomainError(
                f"a process may only increase or decrease, not `{group.head}`", group.place
            )
        return ChangeFunction(change, function, _rate(group.items[2], scope), group.place)
    return ChangeFunction(change, function, parse_expression(group.items[2], scope), group.place)


def _rate(node: Node, scope: Scope) -> Expression:
    """Return the factor beside `#t`."""
    if isinstance(node, Word) and node.text == "#t":
        return Number(1.0, node.place)
    if isinstance(node, Group) and node.head == "*" and len(node.items) == 3:
        left, right = node.items[1:]
        if isinstance(left, Word) and left.text == "#t":
            return parse_expression(right, scope)
        if isinstance(right, Word) and right.text == "#t":
            return parse_expression(left, scope)
    raise DomainError(
        "the change in a process must be a rate times `#t`",
        node.place,
        "write `(* #t rate)`",
    )
