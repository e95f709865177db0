"""Rules about the instances of a domain: what never or always happens, and what is never safe."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import NamedTuple

from serp.authoring.lint.conditions import Pair, contradiction, threshold
from serp.authoring.lint.subject import LintSubject, rule
from serp.model import ground_model as g
from serp.model.ground_model import UNSAFE_TARGET, linear
from serp.pddl import syntax as x
from serp.pddl.source import DomainWarning, Edit, Fix, Place
from serp.pddl.syntax import Change, Kind

_BEYOND = {"<": ">", "<=": ">", ">": "<", ">=": "<"}
"""Comparison → what holds where it does not hold, but for one number."""
_POSITIVE = re.compile(r"\s(\d[\d.]*)\s*\)\Z")
_CANNOT = {
    Kind.ACTION: "can never be applied",
    Kind.PROCESS: "can never run",
    Kind.EVENT: "can never fire",
}


@rule("no-action")
def _no_action(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.actions:
        text, advice = "no ground action, so there is nothing to plan with", ""
        if subject.waits_for_problem:
            advice = (
                "give the problem file that names the objects: NAME-problem.pddl beside "
                "NAME.pddl, or `serp check domain.pddl problem.pddl`"
            )
        yield DomainWarning(text, subject.domain.syntax.place.opening, advice=advice)


@rule("nothing-unsafe", needs_problem=True)
def _nothing_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    if not any(g.flagging(schema, UNSAFE_TARGET) for schema in subject.anywhere.schemas):
        text = "nothing is ever `(unsafe)`, so no action will be refused"
        yield DomainWarning(text, subject.domain.syntax.place.opening)


@rule("no-reward", needs_problem=True)
def _no_reward(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.rewarding:
        text = "nothing changes `(reward)`, so the planner has no reason to prefer an action"
        yield DomainWarning(text, subject.domain.syntax.place.opening)


@rule("schema-without-use", needs_problem=True)
def _schema_without_use(subject: LintSubject) -> Iterator[DomainWarning]:
    syntax, problem = subject.domain.syntax, subject.domain.problem_syntax
    types = {known.type for known in (problem.objects if problem else syntax.constants).values()}
    for schema in syntax.schemas:
        what, place = f"{schema.kind.value} `{schema.name}`", schema.place.opening
        instances = subject.instances.get(schema.name)
        if instances is None:
            empty = next(
                (p.types for p in schema.parameters
                 if not any(syntax.admits(p, known) for known in types)),
                (),
            )  # fmt: skip
            why = "its precondition can never hold" + (" in this problem" if problem else "")
            if empty:
                nor = "" if problem else " (nor a problem file that could name some)"
                why = f"there is no object of type `{'/'.join(empty)}`{nor}"
            yield DomainWarning(f"{what} has no instance: {why}", place)
        # Waiting is an action where the world moves on by itself.
        elif not any(map(g.writes, instances)) and not (
            schema.kind is Kind.ACTION and not schema.effects and subject.anywhere.processes
        ):
            yield DomainWarning(f"{what} changes nothing", place)


# Conditions --------------------------------------------------------------------------------------


@rule("always-true", local=True)
def _always_true(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find comparisons that hold in every state, alone or with another one of the same `or`."""
    for what, schemas in _possible(subject):
        # None where it does not hold in every instance.
        always: dict[tuple[Place, ...], DomainWarning | None] = {}
        for schema in schemas:
            conditions = dict.fromkeys(effect.condition for effect in schema.effects)
            compared = {
                places: several
                for test in x.nodes_in(schema.preconditions, *conditions)
                for several in _alternatives(test, subject)
                if always.get(places := tuple(one.place for one in several), True)
            }
            if compared and not contradiction(schema.preconditions, subject.theta):
                for places, several in compared.items():
                    warning = _tautology(several, what, subject)
                    always[places] = always.get(places, warning) and warning
        yield from filter(None, always.values())


def _alternatives(test: object, subject: LintSubject) -> Iterator[tuple[g.Compare, ...]]:
    """Yield a comparison alone, and the pairs of those in an `or` that is written as one."""
    if isinstance(test, g.Compare):
        yield (test,)
    elif isinstance(test, g.AnyOf):
        # Operands of one list that are compared with one another.
        comparisons = [
            operand
            for operand in test.operands[:40]
            if isinstance(operand, g.Compare)
            and operand.operator in _BEYOND
            and not any(operand.place.within(place) for place in subject.quantified)
        ]
        yield from combinations(comparisons, 2)


def _tautology(
    compared: tuple[g.Compare, ...], what: str, subject: LintSubject
) -> DomainWarning | None:
    """Return a warning if a comparison, or one of two, holds in every state of every problem."""
    parameters = subject.anywhere.parameters
    for part in x.nodes_in(*compared):
        if isinstance(part, g.ParameterRef) and parameters[part.parameter].role == "initial":
            return None
    first, second = compared[0], compared[-1]
    if len(compared) == 1:
        text = f"`{first.place.text}` in {what} always holds"
        never = contradiction([g.Not(first, first.place)], subject.theta)
        return DomainWarning(text, first.place) if never else None
    neither = [replace(one, operator=_BEYOND[one.operator]) for one in compared]
    pair = contradiction(neither, subject.theta)
    if not pair or pair[0] == pair[1]:
        return None
    fix = None
    if number := _POSITIVE.search(second.place.source.text, second.place.start, second.place.end):
        fix = Fix((Edit(number.start(1), number.start(1), "-"),), sure=False)
    return DomainWarning(
        f"`{first.place.text}` or `{second.place.text}` always holds in {what}",
        second.place,
        advice="is a minus missing?" if fix else "",
        fix=fix,
    )


@rule("always-unsafe")
def _always_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    theta = subject.theta
    for what, schemas in _possible(subject):
        kind, place = schemas[0].kind, schemas[0].place.opening
        if kind is Kind.ACTION and all(_unsafe(action, theta) for action in schemas):
            yield DomainWarning(
                f"{what} is unsafe wherever it can be applied: it is executed only where every "
                "other action is unsafe too",
                place,
            )
        if kind is Kind.EVENT and any(
            all(contradiction([g.Not(test, event.place)], theta) for test in event.preconditions)
            and _unsafe(event, theta)
            for event in schemas
        ):
            yield DomainWarning(f"{what} makes every action unsafe: it always fires", place)


def _unsafe(schema: g.GroundSchema, theta: list[float]) -> bool:
    """Whether the condition of an effect `(unsafe)` follows from the precondition."""
    return any(
        contradiction((*schema.preconditions, g.Not(effect.condition, effect.place)), theta)
        for effect in schema.effects
        if g.sets(effect, UNSAFE_TARGET)
    )


@rule("contradictory-condition", local=True)
def _contradictory_condition(subject: LintSubject) -> Iterator[DomainWarning]:
    for name, schemas in subject.telling.items():
        if pair := _contradiction_in_all(subject, schemas):
            kind, place = schemas[0].kind, schemas[0].place.opening
            yield _exclusion(f"{kind.value} `{name}` {_CANNOT[kind]}", pair, place)


@rule("dead-effect", local=True)
def _dead_effect(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find effects under a `when` that can hold in no instance."""
    for what, schemas in _possible(subject):
        never: dict[Place, Pair | None] = {}
        for schema in schemas:
            for effect in schema.effects:
                place, condition = effect.place, effect.condition
                if never.get(place, True) and not isinstance(condition, g.Constant):
                    pair = contradiction((*schema.preconditions, condition), subject.theta)
                    never[place] = pair and (never.get(place) or pair)
        for place, pair in never.items():
            if pair:
                yield _exclusion(f"`{place.text}` in {what} can never happen", pair, place)


def _possible(subject: LintSubject) -> Iterator[tuple[str, list[g.GroundSchema]]]:
    """Yield kind with name, and instances, of the schemas that can happen."""
    for name, schemas in subject.telling.items():
        if not _contradiction_in_all(subject, schemas):
            yield f"{schemas[0].kind.value} `{name}`", schemas


def _contradiction_in_all(subject: LintSubject, schemas: list[g.GroundSchema]) -> Pair | None:
    """Return tests of the first instance that exclude each other if there are some in all."""
    first: Pair | None = None
    for schema in schemas:
        pair = contradiction(schema.preconditions, subject.theta)
        if pair is None:
            return None
        first = first or pair
    return first


def _exclusion(problem: str, pair: Pair, otherwise: Place) -> DomainWarning:
    """Return the warning of two tests that exclude each other, at the second in the file."""
    tests = [test for test in pair if not isinstance(test, g.Constant)]
    if len(tests) == 2 and tests[0].place.source is tests[1].place.source:
        tests.sort(key=lambda test: test.place.start)
    same, bounds = pair[0] == pair[1], all(isinstance(test, g.Compare) for test in pair)
    shown = (
        " and ".join(f"`{test.place.text}`" for test in (tests[:1] if same else tests))
        or "a condition"
    )
    return DomainWarning(
        f"{problem}: {shown} {'never holds' if same else 'exclude each other'}",
        tests[-1].place if tests else otherwise,
        advice="write `or` if one of the two is enough" if bounds and not same else "",
    )


# Signs -------------------------------------------------------------------------------------------


class _Limit(NamedTuple):
    """A comparison of a fluent with a number; `side` is 1 for more, -1 for less, 0 for `=`."""

    fluent: int
    side: int
    number: float
    place: Place


@rule("one-way")
def _one_way(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find limits on the side that a number comes from, in files that only ever move it away.

    One is the condition of the change itself, where nothing else waits for the number farther on;
    the other one is that of an event which sets the number back to the limit.
    """
    wrong_way = "is a sign, or the comparison, the wrong way round?"
    theta = subject.theta

    @cache  # instances share many comparisons
    def limit_of(comparison: g.Compare) -> _Limit | None:
        if (limit := threshold(comparison, theta)) is None:
            return None
        fluent, operator, number = limit
        return _Limit(fluent, (">" in operator) - ("<" in operator), number, comparison.place)

    changes: dict[int, list[tuple[int, list[_Limit], Place]]] = defaultdict(list)  # with the sign
    stops: dict[int, list[_Limit]] = defaultdict(list)
    farthest: dict[tuple[int, int], float] = defaultdict(lambda: -math.inf)  # by fluent and side
    for schema in subject.anywhere.schemas:
        for test in (*schema.preconditions, *(effect.condition for effect in schema.effects)):
            for limit in filter(None, map(limit_of, g.comparisons_of(test))):
                key = limit.fluent, limit.side
                farthest[key] = max(farthest[key], limit.number * limit.side)
        for effect in schema.effects:
            if not isinstance(effect, g.SetNumber) or effect.target < 0:
                continue
            condition = effect.condition
            tests = condition.operands if isinstance(condition, g.All) else (condition,)
            every = (limit_of(t) for t in (*schema.preconditions, *tests)
                     if isinstance(t, g.Compare))  # fmt: skip
            limits = [limit for limit in every if limit and limit.fluent == effect.target]
            value = linear(effect.value, theta)
            number = None if value.terms else float(value.constant)
            if effect.change is Change.ASSIGN and number in [limit.number for limit in limits]:
                stops[effect.target] += limits
            else:
                sign = _sign(effect.change, number)
                changes[effect.target].append((sign, limits, effect.place))
    for fluent, ways in changes.items():
        (sign, *others) = {sign for sign, _, _ in ways}
        if not sign or others:
            continue
        name = subject.anywhere.fluents[fluent].name
        never = f"nothing makes `{name}` {'less' if sign > 0 else 'more'}"
        for limit in stops[fluent]:
            if limit.side == -sign:
                text = f"{never}, so `{limit.place.text}` does not come about"
                yield DomainWarning(text, limit.place, advice=wrong_way)
        for _, limits, place in ways if not stops[fluent] else ():
            behind = bool(limits) and all(limit.side == sign for limit in limits)
            if behind and farthest[fluent, sign] <= min(limit.number * sign for limit in limits):
                shown = limits[0].place.text
                text = f"{never}, and `{shown}` does not stop this change of it"
                yield DomainWarning(text, place, advice=wrong_way)


def _sign(change: Change, number: float | None) -> int:
    """Return which way a change by a number goes; 0 where that depends on the state."""
    if change.group != "add" or not number:
        return 0
    return 1 if (number > 0) == (change is Change.INCREASE) else -1
