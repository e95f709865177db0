"""Parsing numeric expressions, with names and types checked in place."""

from __future__ import annotations

import re
from collections.abc import Hashable

from serp.pddl import slips
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word
from serp.pddl.scope import (
    TOTAL_TIME,
    Scope,
    declared_as,
    expect_group,
    parse_arguments,
    parse_parameters,
    parse_term,
    unsupported,
    without_parentheses,
)
from serp.pddl.source import DomainError, Place

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?\Z", re.ASCII)
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
    if not isinstance(node, Word) or not _NUMBER.match(node.text):
        if isinstance(node, Word) and (slip := slips.in_word(node)):
            raise slip
        shown = node.text if isinstance(node, Word) else node.place.text
        raise DomainError(f"expected a number, found `{shown}`", node.place)
    value = float(node.text)
    if value in (float("inf"), float("-inf")):
        raise DomainError(f"`{node.text}` is too large a number", node.place)
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
    try:
        return _expression(as_function(node, scope), scope)
    except DomainError:
        if isinstance(node, Group) and (slip := slips.in_number(node, scope.declarations)):
            raise slip from None
        raise


def _expression(node: Node, scope: Scope) -> x.Expression:
    if isinstance(node, Word):
        if is_number(node):
            return parse_number(node)
        if node.text == "#t":
            raise DomainError(
                "`#t` may be used only in a process, as a factor of a rate",
                node.place,
                "write `(increase (f) (* #t rate))` inside a `(:process ...)`",
            )
        if slip := slips.in_word(node):
            raise slip
        raise DomainError(
            f"expected a number or `(...)`, found `{node.text}`",
            node.place,
            f"a function needs parentheses: `({node.text})`",
        )
    if scope.calculates(node.head):
        return _arithmetic(node, scope)
    if node.head == TOTAL_TIME:
        if not scope.in_metric or len(node.items) != 1:
            raise DomainError("`(total-time)` may be used only in a metric", node.place)
        return x.TotalTime(node.place)
    declaration = declared_as(node, scope, numeric=True)
    if declaration.name == x.REWARD and not scope.in_metric:
        raise DomainError(
            "`(reward)` cannot be read; it is only ever increased or decreased",
            node.place,
            code="reserved-name",
        )
    return x.FunctionTerm(declaration.name, parse_arguments(node, declaration, scope), node.place)


def _arithmetic(group: Group, scope: Scope) -> x.Arithmetic:
    max_chain = 100
    operator = group.head
    if operator in x.MATH_FUNCTIONS and not scope.math:
        raise DomainError(
            f"`{operator}` extends PDDL and requires `{x.MATH_REQUIREMENT}`",
            group.items[0].place,
            f"list `{x.MATH_REQUIREMENT}` under :requirements; other PDDL tools refuse it",
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
        undefined = ""
        if operator == "/" and last.value == 0.0:
            undefined = "a division by zero"
        elif operator == "sqrt" and last.value < 0.0:
            undefined = "a root of a negative number"
        if undefined:
            raise DomainError(undefined, last.place, "it never has a result", code="no-result")
    expression = x.Arithmetic(operator, operands, group.place)
    if _chain(expression) > max_chain:
        raise DomainError(
            f"this expression has more than {max_chain} operations in a row",
            expression.place,
            "assign a part of it to a function first",
            code="too-large",
        )
    return expression


def _chain(expression: x.Expression) -> int:
    """Return how many operations wait for one another at most (operands are taken in pairs)."""
    if not isinstance(expression, x.Arithmetic):
        return 0
    return max(map(_chain, expression.operands)) + max(1, len(expression.operands) - 1)


def parse_condition(node: Node, scope: Scope) -> x.Condition:
    """Parse a condition; `()` is the empty conjunction."""
    try:
        return _condition(node, scope)
    except DomainError:
        if slip := slips.in_form(node, slips.CONDITION, scope.declarations):
            raise slip from None
        raise


def _condition(node: Node, scope: Scope) -> x.Condition:
    group = expect_group(node, "a condition")
    if not group.items:
        return x.Connective("and", (), group.place)
    head = group.head
    if head in ("and", "or", "not", "imply"):
        return _connective(group, scope)
    if head in ("forall", "exists"):
        parameters, body = parse_quantifier(group, scope)
        inner = scope.bind(parameters)
        return x.Quantified(head, parameters, parse_condition(body, inner), group.place)
    if head in ("<", "<=", "=", ">=", ">"):
        return _comparison(group, scope)
    if head == "preference":
        raise unsupported("preferences are not supported", group.place, "preference")
    declaration = declared_as(group, scope, numeric=False)
    return x.Atom(declaration.name, parse_arguments(group, declaration, scope), group.place)


def _connective(group: Group, scope: Scope) -> x.Connective:
    operands: list[x.Condition] = []
    for item in group.items[1:]:
        with item.place.source.recovering():
            operands.append(parse_condition(item, scope))
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
        advice = f"write `({group.head} a b)`; put several comparisons under `and`"
        found = f"`{group.head}` compares two values, found {len(group.items) - 1}"
        raise DomainError(found, group.place, advice)
    left, right = (as_function(node, scope) for node in group.items[1:])
    if group.head == "=" and not any(isinstance(n, Group) or is_number(n) for n in (left, right)):
        return x.SameObject(parse_term(left, scope), parse_term(right, scope), group.place)
    return x.NumericComparison(
        group.head, parse_expression(left, scope), parse_expression(right, scope), group.place
    )


def refuse_contradictions(effects: tuple[x.Effect, ...]) -> None:
    """Check effects that happen together, and those under each `when` and `forall`.

    Effects whose conditions or objects differ may exclude each other: what they come to is found
    out when they are applied.
    """
    changes: dict[Hashable, list[x.ChangeFunction]] = {}
    for effect in effects:
        if isinstance(effect, x.When | x.ForallEffect):
            refuse_contradictions(effect.effects)
        elif isinstance(effect, x.Chance):
            for outcome in effect.outcomes:
                refuse_contradictions(outcome.effects)
        elif isinstance(effect, x.ChangeFunction):
            others = changes.setdefault(x.meaning(effect.function), [])
            for first in others:
                if _contradict(first, effect):
                    raise DomainError(
                        f"`{effect.place.text}` contradicts `{first.place.text}` in line "
                        f"{first.place.line}: both would have to happen at once",
                        effect.place,
                        "keep one of the two, or put each under a `when`, with conditions that "
                        "exclude each other",
                        code="contradictory-effects",
                    )
            others.append(effect)


def _contradict(first: x.ChangeFunction, second: x.ChangeFunction) -> bool:
    if first.change.group != second.change.group:
        return True
    numbers = isinstance(first.value, x.Number) and isinstance(second.value, x.Number)
    same = x.meaning(first.value) == x.meaning(second.value)
    return numbers and first.change is x.Change.ASSIGN and not same


_CHANGES = {change.value: change for change in x.Change}


def parse_effects(node: Node, scope: Scope) -> tuple[x.Effect, ...]:
    """Parse an effect into its parts, with every `and` flattened."""
    try:
        return _effects(node, scope)
    except DomainError:
        if slip := slips.in_form(node, slips.EFFECT, scope.declarations):
            raise slip from None
        raise


def _effects(node: Node, scope: Scope) -> tuple[x.Effect, ...]:
    group = expect_group(node, "an effect")
    if not group.items:
        return ()
    head = group.head
    if head == "and":
        effects: list[x.Effect] = []
        for item in group.items[1:]:
            with item.place.source.recovering():
                effects += parse_effects(item, scope)
        return tuple(effects)
    if head == "forall":
        parameters, body = parse_quantifier(group, scope)
        inner = parse_effects(body, scope.bind(parameters))
        return (x.ForallEffect(parameters, inner, group.place),)
    if head == "when":
        return (_when(group, scope),)
    if head in _CHANGES:
        return (_change(group, scope),)
    if head == "not":
        if len(group.items) != 2:
            raise DomainError("`not` takes one predicate", group.place)
        return (_set_predicate(group.items[1], scope, value=False, place=group.place),)
    if head in ("oneof", "probabilistic") and head not in scope.declarations:
        return (_chance(group, scope),)
    if head in ("or", "exists", "imply") and head not in scope.declarations:
        raise DomainError(
            f"`{head}` is not supported in an effect",
            group.place,
            "effects are `and`, `forall`, `when`, `probabilistic`, predicates and numeric changes",
            code="unsupported",
        )
    return (_set_predicate(group, scope, value=True, place=group.place),)


def _when(group: Group, scope: Scope) -> x.When:
    if scope.in_process:
        raise DomainError(
            "`when` is not supported in a process",
            group.place,
            "write the condition under :precondition, or write two processes",
        )
    if len(group.items) != 3:
        raise slips.several_after(group, 2, "`when` takes one condition and one effect")
    condition, effect = group.items[1:]
    if _changes(condition, scope) and not _changes(effect, scope):
        problem = "condition and effect of `when` are in the wrong order"
        raise slips.swapped(group, problem, condition.place, "wrong-kind")
    parsed = x.When(parse_condition(condition, scope), parse_effects(effect, scope), group.place)
    for inner in x.nodes_in(parsed.effects):
        if isinstance(inner, x.When):
            text = "`when` inside `when`: other PDDL tools may drop the outer condition"
            inner.place.warn(text, advice="write one `when` with both conditions under `and`")
    return parsed


def _chance(group: Group, scope: Scope) -> x.Chance:
    """Parse `(probabilistic p effect ...)`, or `(oneof effect ...)`, all equally likely."""
    if not scope.in_action:
        raise DomainError(
            f"`{group.head}` is supported in actions only",
            group.place,
            "write the random effect in the actions that cause it",
            code="unsupported",
        )
    items = group.items[1:]
    chances: list[float] = [1.0 / len(items) for _ in items] if group.head == "oneof" else []
    effects = items
    if group.head == "probabilistic":
        if not items or len(items) % 2:
            raise DomainError(
                "`probabilistic` takes pairs of a probability and an effect", group.place,
                "write `(probabilistic 0.8 (moved) 0.1 (slipped))`",
            )  # fmt: skip
        chances, effects = [_probability(node) for node in items[::2]], items[1::2]
    if not items or sum(chances) > 1.0 + 1e-9:
        problem = f"the probabilities add up to {sum(chances):g}" if items else "`oneof` is empty"
        raise DomainError(problem, group.place, "they may add up to at most 1")
    return x.Chance(
        tuple(
            x.ChanceOutcome(chance, parse_effects(node, scope), node.place)
            for chance, node in zip(chances, effects, strict=True)
            if chance > 0.0
        ),
        group.place,
    )


def _probability(node: Node) -> float:
    """Parse a probability: a number from 0 to 1, or a fraction such as `1/3`."""
    above, slash, below = node.text.partition("/") if isinstance(node, Word) else ("", "", "")
    if slash and above.isdecimal() and below.isdecimal() and int(below):
        value = int(above) / int(below)
    else:
        value = parse_number(node).value
    if not 0.0 <= value <= 1.0:
        raise DomainError("a probability must be a number from 0 to 1", node.place)
    return value


def _changes(node: Node, scope: Scope) -> bool:
    """Whether a form is a change of a function, alone or under `and`."""
    if not isinstance(node, Group) or node.head in scope.declarations:
        return False
    return node.head in _CHANGES or (
        node.head == "and" and any(_changes(item, scope) for item in node.items[1:])
    )


def _set_predicate(node: Node, scope: Scope, *, value: bool, place: Place) -> x.SetPredicate:
    group = expect_group(node, "a predicate")
    if scope.in_process:
        raise DomainError(
            "a process may only increase or decrease functions",
            place,
            "set predicates in an action or in an `(:event ...)`",
        )
    declaration = declared_as(group, scope, numeric=False)
    if declaration.name in scope.derived:
        raise DomainError(
            f"`{declaration.name}` is derived, so no effect can set it",
            place,
            "change what its `:derived` conditions read",
            code="wrong-kind",
        )
    if declaration.reserved and not value:
        raise DomainError(
            f"`({declaration.name})` can only be made true",
            place,
            "it is false at the start of every step",
            code="reserved-name",
        )
    atom = x.Atom(declaration.name, parse_arguments(group, declaration, scope), group.place)
    return x.SetPredicate(atom, value, place)


def _change(group: Group, scope: Scope) -> x.ChangeFunction:
    if len(group.items) != 3:
        raise DomainError(f"`{group.head}` takes a function and a value", group.place)
    change = _CHANGES[group.head]
    if is_number(group.items[1]) and isinstance(group.items[2], Group):
        problem = f"`{group.head}` takes a function first, then a value"
        raise slips.swapped(group, problem, group.items[1].place, "malformed")
    target = expect_group(as_function(group.items[1], scope), "a function")
    declaration = declared_as(target, scope, numeric=True)
    arguments = parse_arguments(target, declaration, scope)
    function = x.FunctionTerm(declaration.name, arguments, target.place)
    additive = change in (x.Change.INCREASE, x.Change.DECREASE)
    if declaration.name == x.REWARD and not additive:
        raise DomainError(
            f"`(reward)` may only be increased or decreased, not `{group.head}`",
            group.place,
            "write `(increase (reward) ...)`; the reward of a step begins at 0",
            guess=f"(increase {' '.join(map(slips.written, group.items[1:]))})",
            code="reserved-name",
        )
    if scope.in_process:
        if not additive:
            raise DomainError(
                f"a process may only increase or decrease, not `{group.head}`", group.place
            )
        return x.ChangeFunction(change, function, _rate(group.items[2], scope), group.place)
    return x.ChangeFunction(change, function, parse_expression(group.items[2], scope), group.place)


def _rate(node: Node, scope: Scope) -> x.Expression:
    """Return the factor beside `#t`."""
    if isinstance(node, Word) and node.text == "#t":
        return x.Number(1.0, node.place)
    if isinstance(node, Group) and node.head == "*" and len(node.items) == 3:
        left, right = node.items[1:]
        if isinstance(left, Word) and left.text == "#t":
            return parse_expression(right, scope)
        if isinstance(right, Word) and right.text == "#t":
            return parse_expression(left, scope)
    rate = slips.written(node) if "#t" not in node.place.text.lower() else None
    raise DomainError(
        "the change in a process must be a rate times `#t`",
        node.place,
        f"write `(* #t {rate or 'rate'})`",
        guess=f"(* #t {rate})" if rate else None,
    )
