"""The rules: what a file says without use or effect, and what never or always holds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace

from serp.authoring.lint.contradiction import Pair, contradiction
from serp.authoring.lint.subject import LintSubject, rule
from serp.model import ground_model as g
from serp.pddl import syntax as x
from serp.pddl.source import DomainWarning, Edit, Fix, Place
from serp.pddl.syntax import Kind

# What the file says ------------------------------------------------------------------------------

_NEUTRAL = {"add": 0.0, "scale": 1.0}
"""Group of changes → the number that changes nothing."""
_OPPOSITE = {x.Change.INCREASE: "decrease", x.Change.DECREASE: "increase"}


@rule("no-reward", needs_problem=True)
def _no_reward(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.rewarding:
        text = "nothing changes `(reward)`, so the planner has no reason to prefer an action"
        yield DomainWarning(text, subject.domain.syntax.place.opening)


@rule("flag-read-in-action", local=True)
def _flag_read_in_action(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find conditions of actions on `(unsafe)` or `(terminal)`, which start false in every step."""
    for written in subject.schemas:
        what, action = written.what, written.schema.kind is x.Kind.ACTION
        for atom in x.nodes_in(written.conditions) if action else ():
            if isinstance(atom, x.Atom) and subject.domain.syntax.declarations[atom.name].reserved:
                yield DomainWarning(
                    f"`({atom.name})` is false at the start of every step, so {what} always "
                    "finds it false; read it in an event",
                    atom.place,
                )


@rule("unused-name", needs_problem=True)
def _unused_name(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what nothing reads, but for the effects that change it.

    A domain without `(reward)` is for problems with a goal, which may read what is changed.
    """
    syntax, problem = subject.domain.syntax, subject.domain.problem_syntax
    axioms = (axiom.condition for axiom in syntax.axioms)
    read = x.names_in(*(written.conditions for written in subject.schemas), *axioms)
    read |= x.names_in(problem.goal, problem.metric) if problem else set()
    for _, effect in _changes(subject):
        read |= x.names_in(effect.value) - {effect.function.name}
    changed = x.changed_names(*(s.effects for s in syntax.schemas)) | syntax.derived
    if problem is None and x.REWARD not in syntax.declarations:
        read |= changed
    for name, declaration in syntax.declarations.items():
        if name in read or name == x.REWARD or declaration.reserved:
            continue
        what = "function" if declaration.numeric else "predicate"
        flags = "`(reward)` needs" if declaration.numeric else "`(unsafe)`, `(terminal)` need"
        text, advice = "declared, but nothing changes or reads it", ""
        if name in changed:
            text = "changed, but no condition and no reward reads it"
            advice = f"only {flags} no reader"
        yield DomainWarning(f"{what} `{name}` is {text}", declaration.place, advice=advice)


@rule("unused-parameter", local=True)
def _unused_parameter(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    for _, schema, effects in subject.schemas:
        for form in (schema, *x.nodes_in(schema.precondition), *effects):
            if not isinstance(form, x.Schema | x.Quantified | x.ForallEffect):
                continue
            head = form.operator if isinstance(form, x.Quantified) else "forall"
            if form is schema:
                head = f":{schema.kind.value} {schema.name}"
            read = {term.name for term in x.nodes_in(form) if isinstance(term, x.SchemaTerm)}
            for parameter in form.parameters:
                if parameter.name not in read:
                    text = f"parameter `{parameter.name}` of `({head}` is not used"
                    yield DomainWarning(text, parameter.place)


def _changes(subject: LintSubject) -> Iterator[tuple[str, x.ChangeFunction]]:
    for what, _, effects in subject.schemas:
        yield from ((what, effect) for effect in effects if isinstance(effect, x.ChangeFunction))


@rule("no-change", local=True)
def _no_change(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, effect in _changes(subject):
        value, group = effect.value, effect.change.group
        number = value.value if isinstance(value, x.Number) else None
        assigned = group == "assign" and x.meaning(value) == x.meaning(effect.function)
        if assigned or number == _NEUTRAL.get(group, math.nan):
            yield DomainWarning(f"`{effect.place.text}` in {what} changes nothing", effect.place)


@rule("double-negative", local=True)
def _double_negative(subject: LintSubject) -> Iterator[DomainWarning]:
    for what, effect in _changes(subject):
        opposite, value = _OPPOSITE.get(effect.change), effect.value
        if opposite is not None and isinstance(value, x.Number) and value.value < 0.0:
            begin = value.place.start
            yield DomainWarning(
                f"`{effect.place.text}` in {what} acts as `{opposite}`: the number is negative",
                effect.place,
                advice=f"leave out the minus, or write `{opposite}`",
                fix=Fix((Edit(begin, begin + 1, ""),), sure=False),
            )


@rule("set-and-unset", local=True)
def _set_and_unset(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what one list of effects makes false and true: in PDDL, true wins."""
    for what, schema, nodes in subject.schemas:
        inner = (e.effects for e in nodes if isinstance(e, x.When | x.ForallEffect))
        for effects in (schema.effects, *inner):
            settings = [effect for effect in effects if isinstance(effect, x.SetPredicate)]
            made = {x.meaning(effect.atom) for effect in settings if effect.value}
            for effect in settings:
                if not effect.value and x.meaning(effect.atom) in made:
                    yield DomainWarning(
                        f"`{effect.place.text}` in {what} has no effect, because "
                        f"`{effect.atom.place.text}` is made true at the same time",
                        effect.place,
                    )


# Conditions --------------------------------------------------------------------------------------

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
        text, advice = "there is no ground action, so there is nothing to plan with", ""
        if subject.waits_for_problem:
            advice = (
                "give the problem file that names the objects: NAME-problem.pddl beside "
                "NAME.pddl, or `serp check domain.pddl problem.pddl`"
            )
        yield DomainWarning(text, subject.domain.syntax.place.opening, advice=advice)


@rule("schema-without-use", needs_problem=True)
def _schema_without_use(subject: LintSubject) -> Iterator[DomainWarning]:
    syntax, problem = subject.domain.syntax, subject.domain.problem_syntax
    types = {known.type for known in (problem.objects if problem else syntax.constants).values()}
    for schema in syntax.schemas:
        what, place = f"{schema.kind.value} `{schema.name}`", schema.place.opening
        if schema.name not in subject.instances:
            empty = next(
                (p.types for p in schema.parameters
                 if not any(syntax.admits(p, known) for known in types)),
                (),
            )  # fmt: skip
            why = "its precondition can never hold" + (" in this problem" if problem else "")
            if empty:
                nor = "" if problem else ", and no problem file that could declare one"
                why = f"there is no object of type `{'/'.join(empty)}`{nor}"
            yield DomainWarning(f"{what} has no instance: {why}", place)


@rule("always-true", local=True)
def _always_true(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find comparisons that hold in every state, alone or with another one of the same `or`."""
    for what, schemas in _possible(subject):
        common: dict[Place, DomainWarning] | None = None  # those of all instances
        for schema in schemas:
            if common == {}:
                break
            conditions = dict.fromkeys(effect.condition for effect in schema.effects)
            common = {
                test.place: warning
                for test in x.nodes_in(schema.preconditions, *conditions)
                if isinstance(test, g.Compare | g.AnyOf)
                and (common is None or test.place in common)
                and (warning := _tautology(test, what, subject))
            }
        yield from (common or {}).values()


def _tautology(test: g.Compare | g.AnyOf, what: str, subject: LintSubject) -> DomainWarning | None:
    """Return a warning if a test, or two of an `or`, hold in every state of every problem."""
    parameters = subject.anywhere.parameters
    for part in x.nodes_in(test):
        if isinstance(part, g.ParameterRef) and parameters[part.parameter].role == "initial":
            return None
    if isinstance(test, g.Compare):
        never = contradiction([g.Not(test, test.place)], subject.theta)
        text = f"`{test.place.text}` in {what} always holds"
        return DomainWarning(text, test.place) if never else None
    neither = [
        replace(one, operator=_BEYOND[one.operator])
        for one in test.operands
        if isinstance(one, g.Compare) and one.operator in _BEYOND
    ]
    pair = contradiction(neither, subject.theta) or ()
    places = [one.place for one in pair if isinstance(one, g.Compare)]
    if len({*places}) < 2:  # nothing, or one comparison for two objects of a quantifier
        return None
    first, second = places
    fix = None
    if number := _POSITIVE.search(second.source.text, second.start, second.end):
        fix = Fix((Edit(number.start(1), number.start(1), "-"),), sure=False)
    return DomainWarning(
        f"`{first.text}` or `{second.text}` always holds in {what}",
        second,
        advice="is a minus missing?" if fix else "",
        fix=fix,
    )


@rule("contradictory-condition", local=True)
def _contradictory_condition(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find preconditions, and the conditions of a `when`, that can hold in no instance."""
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
    for name, pairs in subject.excluding.items():
        if (pair := pairs[0]) and all(pairs):
            kind, place = subject.telling[name][0].kind, subject.telling[name][0].place.opening
            yield _exclusion(f"{kind.value} `{name}` {_CANNOT[kind]}", pair, place)


def _possible(subject: LintSubject) -> Iterator[tuple[str, list[g.GroundSchema]]]:
    """Yield kind with name, and the instances that can happen, of schemas with such."""
    for name, schemas in subject.telling.items():
        pairs = zip(schemas, subject.excluding[name], strict=True)
        if possible := [schema for schema, pair in pairs if pair is None]:
            yield f"{schemas[0].kind.value} `{name}`", possible


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
