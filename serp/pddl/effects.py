"""Parsing effects, with names and types checked in place."""

from __future__ import annotations

from serp.pddl import slips
from serp.pddl import syntax as x
from serp.pddl.conditions import parse_quantifier, required_condition
from serp.pddl.declarations import expect_group
from serp.pddl.expressions import as_function, is_number, parse_expression
from serp.pddl.scope import INSTEAD, Scope, declared_as, parse_arguments
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError, Place

_CHANGES = {change.value: change for change in x.Change}


def parse_effects(node: Node, scope: Scope, *, inside_when: bool = False) -> tuple[x.Effect, ...]:
    """Parse an effect into its parts, with every `and` flattened."""
    if slip := slips.bare(node, "an effect", scope.declarations):
        raise slip
    group = expect_group(node, "an effect")
    if not group.items:
        return ()
    head = group.head
    if slip := slips.in_effect(group, scope.declarations):
        raise slip
    if head == "and":
        effects: list[x.Effect] = []
        for item in group.items[1:]:
            with item.place.source.recovering():
                effects += parse_effects(item, scope, inside_when=inside_when)
        return tuple(effects)
    if head == "forall":
        parameters, body = parse_quantifier(group, scope)
        inner = parse_effects(body, scope.bind(parameters), inside_when=inside_when)
        return (x.ForallEffect(parameters, inner, group.place),)
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
            INSTEAD.get(head)
            or "effects are deterministic: `and`, `forall`, `when`, predicates and numeric changes",
            code="unsupported",
        )
    return (_set_predicate(group, scope, value=True, place=group.place),)


def _when(group: Group, scope: Scope, *, inside_when: bool) -> x.When:
    if inside_when:
        raise DomainError(
            "`when` inside `when` is not supported (other PDDL tools drop its outer condition)",
            group.place,
            "write one `when` with both conditions under `and`",
            code="unsupported",
        )
    if scope.in_process:
        raise DomainError(
            "`when` is not supported in a process",
            group.place,
            "write the condition under :precondition, or write two processes",
            code="process-effect",
        )
    if len(group.items) == 2 and (apart := _effect_in(group.items[1], scope)):
        raise DomainError(
            "the effect of `when` stands within the `and` of its condition",
            group.place,
            write=f"(when {apart})",
            code="unbalanced-parentheses",
        )
    if len(group.items) != 3:
        raise slips.several_after(group, 2, "`when` takes one condition and one effect")
    condition, effect = group.items[1:]
    if _changes(condition, scope) and not _changes(effect, scope):
        problem = "condition and effect of `when` stand the wrong way round"
        raise slips.swapped(group, problem, condition.place, "wrong-kind")
    return x.When(
        required_condition(condition, scope),
        parse_effects(effect, scope, inside_when=True),
        group.place,
    )


def _changes(node: Node, scope: Scope) -> bool:
    """Whether a form is a change of a function, alone or under `and`."""
    if not isinstance(node, Group) or node.head in scope.declarations:
        return False
    return node.head in _CHANGES or (
        node.head == "and" and any(_changes(item, scope) for item in node.items[1:])
    )


def _effect_in(condition: Node, scope: Scope) -> str | None:
    """Return a condition and an effect that stand under one `and`; None if the last is no effect.

    Only changes and flags are effects for certain: no condition of an action may ask for those.
    """
    if not isinstance(condition, Group) or condition.head != "and" or len(condition.items) < 3:
        return None
    *asked, last = condition.items
    flag = isinstance(last, Group) and last.head in (x.UNSAFE, x.TERMINAL)
    if not (flag or _changes(last, scope)):
        return None
    return f"({' '.join(map(slips.written, asked))}) {slips.written(last)}"


def _set_predicate(node: Node, scope: Scope, *, value: bool, place: Place) -> x.SetPredicate:
    group = expect_group(node, "a predicate")
    if scope.in_process:
        raise DomainError(
            "a process only increases and decreases functions",
            place,
            "set predicates in an action or in an `(:event ...)`",
            code="process-effect",
        )
    declaration = declared_as(group, scope, numeric=False)
    if declaration.name in (x.UNSAFE, x.TERMINAL) and not value:
        raise DomainError(
            f"`({declaration.name})` can only be made true",
            place,
            "it is false at the start of every step",
            code="reserved-use",
        )
    atom = x.Atom(declaration.name, parse_arguments(group, declaration, scope), group.place)
    return x.SetPredicate(atom, value, place)


def _change(group: Group, scope: Scope) -> x.ChangeFunction:
    if len(group.items) != 3:
        raise slips.not_two(group, f"`{group.head}` takes a function and a value")
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
            guess=f"(increase {' '.join(map(slips.written, group.items[1:]))})",
            code="reserved-use",
        )
    if scope.in_process:
        if not additive:
            raise DomainError(
                f"a process may only increase or decrease, not `{group.head}`",
                group.place,
                code="process-effect",
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
        code="process-effect",
    )
