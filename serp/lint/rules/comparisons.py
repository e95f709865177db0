"""Rules: conditions that always hold, and conditions that another one makes needless."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations

from serp.lint.rules.exclusion import contradiction
from serp.lint.subject import LintSubject
from serp.model import ground as g
from serp.pddl.edits import Edit, Fix
from serp.pddl.source import DomainWarning, Place

Leaf = g.Compare | g.Holds | g.Not
Found = dict[Place, tuple[Leaf, ...] | None]
"""Place of a condition → what is found of it, in one instance; None for nothing."""
_BEYOND = {"<": ">", "<=": ">", ">": "<", ">=": "<"}
"""Comparison → what holds where it does not hold, but for one number."""
_MOST = 40
"""Operands of one list that are compared with one another."""
_POSITIVE = re.compile(r"\s(\d[\d.]*)\s*\)\Z")


def _always_true(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find comparisons that hold in every state, alone or with another one of the same `or`."""

    def alone(test: g.Test) -> Found:
        if not isinstance(test, g.Compare) or _depends_on_problem(test, subject.anywhere):
            return {}
        always = contradiction((g.Not(test, test.place),), subject.theta)
        return {test.place: (test,)} if always else {}

    def together(test: g.Test) -> Found:
        found: Found = {}
        leaves = _leaves(test, subject.anywhere) if isinstance(test, g.AnyOf) else []
        for first, second in combinations(leaves, 2):
            if not subject.alike(first, second):
                continue
            both = contradiction((_beyond(first), _beyond(second)), subject.theta)
            if both and both[0] != both[1]:
                found[second.place] = (first, second)
        return found

    for what, schemas in _named(subject):
        for place, _ in _in_every_instance(schemas, subject.theta, (g.Compare,), alone):
            yield DomainWarning(f"`{place.text}` in {what} always holds", place)
        for place, (first, second) in _in_every_instance(
            schemas, subject.theta, (g.AnyOf,), together
        ):
            fix = _with_minus(second.place)
            yield DomainWarning(
                f"`{first.place.text}` or `{place.text}` always holds in {what}",
                place,
                advice="is a minus missing?" if fix else "",
                fix=fix,
            )


def _needless(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find conditions that follow from another one of the same `and`, or imply one of an `or`."""

    def implied(test: g.Test) -> Found:
        found: Found = {}
        leaves = _leaves(test, subject.anywhere)
        if contradiction(leaves, subject.theta) and isinstance(test, g.All):
            return found
        for (k, first), (m, second) in permutations(enumerate(leaves), 2):
            if not subject.alike(first, second):
                continue
            if isinstance(test, g.All):
                stronger, weaker = first, second
            else:
                stronger, weaker = second, first
            if contradiction((g.Not(second, second.place),), subject.theta):
                continue  # it always holds, which is another finding
            if _implies(stronger, weaker, subject) and (
                m > k or not _implies(weaker, stronger, subject)  # of equal ones, the later
            ):
                found.setdefault(second.place, (first, second))
        for either in _disjunctions(test):
            if contradiction((g.Not(either, either.place),), subject.theta):
                continue
            stronger_leaf = (leaf for leaf in leaves if _implies(leaf, either, subject))
            if (first_leaf := next(stronger_leaf, None)) is not None:
                found.setdefault(either.place, (first_leaf, first_leaf))
        return found

    for what, schemas in _named(subject):
        for place, (other, _) in _in_every_instance(
            schemas, subject.theta, (g.All, g.AnyOf), implied
        ):
            why = (
                "stands there twice"
                if place.text == other.place.text
                else f"is needless beside `{other.place.text}`"
            )
            advice = "is it meant to say something else?"
            yield DomainWarning(f"`{place.text}` in {what} {why}", place, advice=advice)


def _dead_alternative(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find alternatives of an `or` that can never hold, alone or beside what else has to hold."""

    def dead(test: g.Test) -> Found:
        beside = test.operands if isinstance(test, g.All) else ()
        found: Found = {}
        for either in _disjunctions(test) or ([test] if isinstance(test, g.AnyOf) else []):
            others = [other for other in beside if other is not either]
            for alternative in either.operands[:_MOST]:
                if isinstance(alternative, g.Constant | g.AnyOf):
                    continue
                never = contradiction((*others, alternative), subject.theta)
                found[alternative.place] = () if never else None
        return found

    for what, schemas in _named(subject):
        for place, _ in _in_every_instance(schemas, subject.theta, (g.All, g.AnyOf), dead):
            yield DomainWarning(f"the alternative `{place.text}` in {what} can never hold", place)


def _disjunctions(test: g.Test) -> list[g.AnyOf]:
    """Return the disjunctions among the operands of a conjunction."""
    operands = test.operands if isinstance(test, g.All) else ()
    return [operand for operand in operands if isinstance(operand, g.AnyOf)]


def _implies(first: Leaf, second: Leaf | g.AnyOf, subject: LintSubject) -> bool:
    return contradiction((first, g.Not(second, second.place)), subject.theta) is not None


def _beyond(test: Leaf) -> g.Test:
    """Return what holds where a test does not, a single number left aside."""
    if isinstance(test, g.Compare) and test.operator in _BEYOND:
        return replace(test, operator=_BEYOND[test.operator])
    return g.Not(test, test.place)


def _named(subject: LintSubject) -> Iterator[tuple[str, Sequence[g.GroundSchema]]]:
    """Yield kind with name, and the instances of each schema."""
    for name, schemas in subject.telling.items():
        yield f"{schemas[0].kind.value} `{name}`", schemas


def _in_every_instance(
    schemas: Sequence[g.GroundSchema],
    theta: Sequence[float],
    kinds: tuple[type, ...],
    look: Callable[[g.Test], Found],
) -> Iterator[tuple[Place, tuple[Leaf, ...]]]:
    """Yield what is found of a condition in all instances that have it and can happen."""
    found: dict[Place, tuple[Leaf, ...]] = {}
    refuted: set[Place] = set()
    for schema in schemas:
        tests = [
            g.All(tuple(schema.preconditions), schema.place),
            *dict.fromkeys(effect.condition for effect in schema.effects),
        ]
        parts = (part for test in tests for part in _parts(test) if isinstance(part, kinds))
        open_parts = [part for part in parts if not refuted >= _places(part)]
        if not open_parts or contradiction(schema.preconditions, theta):
            continue
        for part in open_parts:
            here = look(part)
            refuted |= _places(part) - here.keys()
            for place, leaves in here.items():
                if leaves is None:
                    refuted.add(place)
                else:
                    found.setdefault(place, leaves)
    yield from ((place, here) for place, here in found.items() if place not in refuted)


def _places(test: g.Test) -> set[Place]:
    """Return the places of which something could be found in a condition."""
    operands = test.operands if isinstance(test, g.All | g.AnyOf) else (test,)
    return {operand.place for operand in operands if not isinstance(operand, g.Constant)}


def _parts(test: g.Test) -> Iterator[g.Test]:
    """Yield a condition and those in it."""
    yield test
    match test:
        case g.All(operands) | g.AnyOf(operands):
            for operand in operands:
                yield from _parts(operand)
        case g.Not(operand):
            yield from _parts(operand)


def _leaves(test: g.Test, ground: g.GroundModel) -> list[Leaf]:
    """Return the operands of a list that have none of their own."""
    operands = test.operands if isinstance(test, g.All | g.AnyOf) else ()
    return [
        operand
        for operand in operands[:_MOST]
        if isinstance(operand, g.Compare | g.Holds)
        or (isinstance(operand, g.Not) and isinstance(operand.operand, g.Compare | g.Holds))
        if not _depends_on_problem(operand, ground)
    ]


def _depends_on_problem(test: g.Test, ground: g.GroundModel) -> bool:
    """Whether a test compares with a number that another problem may give otherwise."""
    return any(
        ground.parameters[number].role == "initial"
        for comparison in g.comparisons_of(test)
        for number in (*_numbers(comparison.left), *_numbers(comparison.right))
    )


def _numbers(value: g.Value) -> Iterator[int]:
    match value:
        case g.ParameterRef(parameter):
            yield parameter
        case g.Operation(_, left, right):
            yield from _numbers(left)
            yield from _numbers(right)
        case g.Unary(_, operand):
            yield from _numbers(operand)


def _with_minus(place: Place) -> Fix | None:
    """Return the guess that the number at the end of a comparison should be negative."""
    number = _POSITIVE.search(place.source.text, place.start, place.end)
    if number is None:
        return None
    return Fix((Edit(number.start(1), number.start(1), "-"),), sure=False)


RULES = {
    "always-true": _always_true,
    "redundant-condition": _needless,
    "dead-alternative": _dead_alternative,
}
