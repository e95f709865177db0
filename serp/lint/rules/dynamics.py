"""Rules: numbers that an effect changes for nobody, and events that wait for what never moves."""

from __future__ import annotations

from collections.abc import Iterator

from serp.lint.subject import LintSubject
from serp.pddl import syntax as x
from serp.pddl.source import DomainWarning

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
    moving = _moving(syntax)
    if not any(syntax.declarations[name].numeric for name in moving - {*_FLAGS}):
        return
    problem = domain.problem_syntax
    stated = {function.name for function, _ in problem.values} if problem else set()
    told: set[str] = set()
    for schema in syntax.schemas:
        read = _read_by(schema)
        frozen = [n for n in sorted(read) if syntax.declarations[n].numeric and n not in moving]
        if schema.kind is not x.Kind.EVENT or not read or len(frozen) < len(read):
            continue
        for name in frozen:
            if name not in told and name not in stated:
                told.add(name)
                yield DomainWarning(
                    f"nothing changes `{name}`, and event `{schema.name}` waits for nothing else: "
                    "the planner never sees it begin or end",
                    syntax.declarations[name].place,
                    advice="write what changes it, if that is known",
                )


def _moving(syntax: x.DomainSyntax) -> set[str]:
    """Return what actions and processes change, and events that this can set off."""
    waiting = [(schema, _read_by(schema)) for schema in syntax.schemas]
    moving: set[str] = set()
    while True:
        still: list[tuple[x.Schema, set[str]]] = []
        for schema, read in waiting:
            if schema.kind is x.Kind.EVENT and read and moving.isdisjoint(read):
                still.append((schema, read))
            else:
                moving.update(_changed_by(schema))
        if len(still) == len(waiting):
            return moving
        waiting = still


def _read_by(schema: x.Schema) -> set[str]:
    """Return what the conditions of a schema read."""
    return {name for condition in x.conditions_of(schema) for name in _names(condition)}


def _changed(syntax: x.DomainSyntax) -> set[str]:
    return {name for schema in syntax.schemas for name in _changed_by(schema)}


def _changed_by(schema: x.Schema) -> Iterator[str]:
    for effect in x.nested_effects(schema.effects):
        if isinstance(effect, x.ChangeFunction):
            yield effect.function.name
        elif isinstance(effect, x.SetPredicate):
            yield effect.atom.name


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


RULES = {"never-read": _never_read, "frozen-fluent": _frozen}
