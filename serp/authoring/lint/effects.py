"""Rules: effects that come to nothing, that have the wrong sign, or that nothing reads."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

from serp.authoring.lint.conditions import threshold
from serp.authoring.lint.subject import SCHEMAS, LintSubject
from serp.model import ground as g
from serp.model.ground import linear
from serp.pddl import syntax as x
from serp.pddl.slips import written
from serp.pddl.source import DomainWarning, Edit, Fix, Place
from serp.pddl.syntax import Change

_OPPOSITE = {x.Change.INCREASE: "decrease", x.Change.DECREASE: "increase"}
_NEUTRAL = {
    **dict.fromkeys((x.Change.INCREASE, x.Change.DECREASE), 0.0),
    **dict.fromkeys((x.Change.SCALE_UP, x.Change.SCALE_DOWN), 1.0),
}


def _no_change(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, effect in _changes(subject):
        if effect.change is x.Change.ASSIGN:
            same = isinstance(effect.value, x.FunctionTerm) and (
                effect.value.place.text.lower() == effect.function.place.text.lower()
            )
        else:
            value = effect.value
            same = isinstance(value, x.Number) and value.value == _NEUTRAL[effect.change]
        if same:
            yield DomainWarning(f"`{effect.place.text}` in {what} changes nothing", effect.place)


def _assigned_twice(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find functions that one list of effects sets to two numbers."""
    for schema in subject.domain.syntax.schemas:
        for effects in _lists(schema.effects):
            first: dict[str, x.ChangeFunction] = {}
            for effect in effects:
                if not isinstance(effect, x.ChangeFunction) or effect.change is not x.Change.ASSIGN:
                    continue
                known = first.setdefault(effect.function.place.text.lower(), effect)
                if known.value.place.text.lower() != effect.value.place.text.lower():
                    yield DomainWarning(
                        f"`{effect.place.text}` in {schema.kind.value} `{schema.name}` sets what "
                        f"`{known.place.text}` sets, and is carried out only where both are equal",
                        effect.place,
                    )


def _double_negative(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, effect in _changes(subject):
        opposite = _OPPOSITE.get(effect.change)
        if opposite is None or not isinstance(effect.value, x.Number) or effect.value.value >= 0.0:
            continue
        place = effect.value.place
        yield DomainWarning(
            f"`{effect.place.text}` in {what} is `{opposite}`, because the number is negative",
            effect.place,
            advice=f"leave the minus out, or write `{opposite}`",
            fix=Fix((Edit(place.start, place.start + 1, ""),), sure=False),
        )


def _set_and_unset(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what one list of effects makes false and true: in PDDL, true wins."""
    for schema in subject.domain.syntax.schemas:
        for effects in _lists(schema.effects):
            made = {_key(e.atom) for e in effects if isinstance(e, x.SetPredicate) and e.value}
            for effect in effects:
                if (
                    isinstance(effect, x.SetPredicate)
                    and not effect.value
                    and _key(effect.atom) in made
                ):
                    yield DomainWarning(
                        f"`{effect.place.text}` in {schema.kind.value} `{schema.name}` comes to "
                        f"nothing: `{effect.atom.place.text}` is made true at the same time",
                        effect.place,
                    )


def _key(atom: x.Atom) -> tuple[str, ...]:
    return (atom.name, *(argument.name for argument in atom.arguments))


def _lists(effects: tuple[x.Effect, ...]) -> Iterator[tuple[x.Effect, ...]]:
    """Yield effects that happen together, and those under each `when` and `forall`."""
    yield effects
    for effect in effects:
        if isinstance(effect, x.When | x.ForallEffect):
            yield from _lists(effect.effects)


def _changes(subject: LintSubject) -> Iterator[tuple[str, x.ChangeFunction]]:
    for schema in subject.domain.syntax.schemas:
        for effect in x.nested_effects(schema.effects):
            if isinstance(effect, x.ChangeFunction):
                yield f"{schema.kind.value} `{schema.name}`", effect


_BELOW, _ABOVE = ("<", "<="), (">", ">=")


class _Limit(NamedTuple):
    """A comparison of a fluent with a number: `operator` as if the fluent stood on the left."""

    fluent: int
    operator: str
    number: float
    place: Place


class _Change(NamedTuple):
    """How an effect changes a fluent: by a number of a sign (0: not known), within limits."""

    sign: int
    limits: list[_Limit]
    place: Place


def _one_way(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find limits on the side that a number comes from, in files that only ever move it away.

    One is the condition of the change itself, where nothing else waits for the number farther on;
    the other one is that of an event which sets the number back to the limit.
    """
    changes: dict[int, list[_Change]] = defaultdict(list)
    stops: dict[int, list[_Limit]] = defaultdict(list)
    waiting: list[_Limit] = []

    @cache  # instances share many comparisons
    def limit_of(comparison: g.Compare) -> _Limit | None:
        limit = threshold(comparison, subject.theta)
        return limit and _Limit(*limit, comparison.place)

    for schema in subject.anywhere.schemas:
        for test in (*schema.preconditions, *(effect.condition for effect in schema.effects)):
            waiting += filter(None, map(limit_of, g.comparisons_of(test)))
        for effect in schema.effects:
            if not isinstance(effect, g.SetNumber) or effect.target < 0:
                continue
            tests = (*schema.preconditions, *_conjuncts(effect.condition))
            compared = (limit_of(test) for test in tests if isinstance(test, g.Compare))
            limits = [limit for limit in compared if limit and limit.fluent == effect.target]
            value = linear(effect.value, subject.theta)
            number = None if value.terms else float(value.constant)
            if effect.change is Change.ASSIGN and number in [limit.number for limit in limits]:
                stops[effect.target] += limits
            else:
                sign = 0 if number is None else _sign(effect.change, number)
                changes[effect.target].append(_Change(sign, limits, effect.place))
    farthest: dict[tuple[int, tuple[str, str]], float] = defaultdict(lambda: -math.inf)
    for limit in waiting:
        side, way = (_ABOVE, 1) if limit.operator in _ABOVE else (_BELOW, -1)
        if limit.operator in side:
            key = limit.fluent, side
            farthest[key] = max(farthest[key], limit.number * way)
    for fluent, ways in changes.items():
        (sign, *others) = {change.sign for change in ways}
        if not sign or others:
            continue
        name = subject.anywhere.fluents[fluent].name
        never = f"nothing makes `{name}` {'less' if sign > 0 else 'more'}"
        behind, ahead = (_ABOVE, _BELOW) if sign > 0 else (_BELOW, _ABOVE)
        for limit in stops[fluent]:
            if limit.operator in ahead:
                yield DomainWarning(
                    f"{never}, so `{limit.place.text}` does not come about",
                    limit.place,
                    advice="is a sign, or the comparison, the wrong way round?",
                )
        for change in ways:
            operators = {limit.operator for limit in change.limits}
            if not operators or not operators.issubset(behind) or stops[fluent]:
                continue
            if farthest[fluent, behind] > min(limit.number * sign for limit in change.limits):
                continue  # something else waits for the number farther on
            yield DomainWarning(
                f"{never}, and `{change.limits[0].place.text}` does not stop this change of it",
                change.place,
                advice="is a sign, or the comparison, the wrong way round?",
            )


def _conjuncts(test: g.Test) -> tuple[g.Test, ...]:
    return test.operands if isinstance(test, g.All) else (test,)


def _sign(change: Change, number: float) -> int:
    """Return which way a change by a number goes; 0 where that depends on the state."""
    if change.group != "add" or not number:
        return 0
    return 1 if (number > 0) == (change is Change.INCREASE) else -1


_FLAGS = (x.REWARD, x.UNSAFE, x.TERMINAL)


def _never_read(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find functions that effects change, and that nothing reads but these effects.

    A domain without `(reward)` is for problems with a goal, which may read anything.
    """
    domain = subject.domain
    if domain.problem_syntax is None and x.REWARD not in domain.syntax.declarations:
        return
    read: set[str] = set()
    for schema in domain.syntax.schemas:
        for condition in x.conditions_of(schema):
            read.update(_names(condition))
        for effect in x.nested_effects(schema.effects):
            if isinstance(effect, x.ChangeFunction):
                read.update({*_names(effect.value)} - {effect.function.name})
    problem = domain.problem_syntax
    for condition in x.nested_conditions(problem.goal if problem else None):
        read.update(_names(condition))
    if problem is not None and problem.metric is not None:
        read.update(_names(problem.metric.expression))
    changed = _changed(domain.syntax)
    for declaration in domain.syntax.declarations.values():
        name = declaration.name
        if name in changed and name not in read and name not in _FLAGS:
            what = "function" if declaration.numeric else "predicate"
            flags = "`(reward)` needs" if declaration.numeric else "`(unsafe)`, `(terminal)` need"
            yield DomainWarning(
                f"{what} `{name}` is changed, but nothing reads it: no condition, no reward",
                declaration.place,
                advice=f"only {flags} no reader",
            )


def _frozen(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find functions that nothing changes, and that alone decide whether an event ever fires.

    A file that leaves its dynamics out altogether is left alone, and so is what a problem states.
    """
    domain, syntax = subject.domain, subject.domain.syntax
    moving = _changed(syntax)
    if not any(syntax.declarations[name].numeric for name in moving - set(_FLAGS)):
        return
    problem = domain.problem_syntax
    stated = {function.name for function, _ in problem.values} if problem else set()
    warned: set[str] = set()
    for schema in syntax.schemas:
        read = {name for condition in x.conditions_of(schema) for name in _names(condition)}
        frozen = all(syntax.declarations[n].numeric and n not in moving for n in read)
        if schema.kind is not x.Kind.EVENT or not frozen:
            continue
        for name in sorted(read - stated - warned):
            warned.add(name)
            yield DomainWarning(
                f"nothing changes `{name}`, and event `{schema.name}` waits for nothing else: "
                "the planner never sees it begin or end",
                syntax.declarations[name].place,
                advice="write what changes it, if that is known",
            )


def _changed(syntax: x.DomainSyntax) -> set[str]:
    """Return the functions and predicates that any effect changes."""
    return {
        effect.function.name if isinstance(effect, x.ChangeFunction) else effect.atom.name
        for schema in syntax.schemas
        for effect in x.nested_effects(schema.effects)
        if isinstance(effect, x.ChangeFunction | x.SetPredicate)
    }


def _names(node: x.Condition | x.Expression) -> Iterator[str]:
    """Yield the predicates and functions that a condition (not those in it) or a number reads."""
    match node:
        case x.Atom(name) | x.FunctionTerm(name):
            yield name
        case x.NumericComparison(_, left, right):
            yield from _names(left)
            yield from _names(right)
        case x.Arithmetic(_, operands):
            for operand in operands:
                yield from _names(operand)


def _same_schema(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find schemas that say the same as an earlier one.

    Actions that do nothing, or cost something only, are described by their names: nobody has
    measured what they do.
    """
    known: dict[tuple[str, str], str] = {}
    schemas = subject.domain.syntax.schemas
    telling = {s.name for s in schemas if s.kind is not x.Kind.ACTION or _changes_something(s)}
    for section in subject.sections(*SCHEMAS):
        name = section.items[1].place.text.lower() if len(section.items) > 1 else ""
        if name not in telling:
            continue
        rest = " ".join(written(item).lower() for item in section.items[2:])
        first = known.setdefault((section.head, rest), name)
        if first != name:
            kind = section.head[1:]
            yield DomainWarning(
                f"{kind} `{name}` says the same as {kind} `{first}`",
                section.place.opening,
                advice="is one of them a copy that should have been changed?",
            )


def _changes_something(schema: x.Schema) -> bool:
    return any(
        (isinstance(effect, x.ChangeFunction) and effect.function.name != x.REWARD)
        or isinstance(effect, x.SetPredicate)
        for effect in x.nested_effects(schema.effects)
    )


RULES = {
    "no-change": _no_change,
    "assigned-twice": _assigned_twice,
    "double-negative": _double_negative,
    "set-and-unset": _set_and_unset,
    "one-way": _one_way,
    "never-read": _never_read,
    "frozen-fluent": _frozen,
    "same-schema": _same_schema,
}
