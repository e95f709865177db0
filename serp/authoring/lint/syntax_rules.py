"""Rules about what a file says: names without use, and effects that come to nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator

from serp.authoring.lint.subject import LintSubject, rule
from serp.pddl import syntax as x
from serp.pddl.source import DomainWarning, Edit, Fix

_NEUTRAL = {"add": 0.0, "scale": 1.0}
"""Group of changes → the number that changes nothing."""
_OPPOSITE = {x.Change.INCREASE: "decrease", x.Change.DECREASE: "increase"}


def _schemas(subject: LintSubject) -> Iterator[tuple[str, x.Schema]]:
    for schema in subject.domain.syntax.schemas:
        yield f"{schema.kind.value} `{schema.name}`", schema


@rule("no-reward", needs_problem=True)
def _no_reward(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.rewarding:
        text = "nothing changes `(reward)`, so the planner has no reason to prefer an action"
        yield DomainWarning(text, subject.domain.syntax.place.opening)


@rule("flag-read-in-action", local=True)
def _flag_read_in_action(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find conditions of actions on `(unsafe)` or `(terminal)`, which start false in every step."""
    for what, schema in _schemas(subject):
        for atom in x.nodes_in(x.conditions_of(schema)) if schema.kind is x.Kind.ACTION else ():
            if isinstance(atom, x.Atom) and atom.name in (x.UNSAFE, x.TERMINAL):
                yield DomainWarning(
                    f"`({atom.name})` starts false in every step, so {what} always finds it "
                    "false; events are the ones that can read it",
                    atom.place,
                )


@rule("unused-name", needs_problem=True)
def _unused_name(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what nothing reads, but for the effects that change it.

    A domain without `(reward)` is for problems with a goal, which may read what is changed.
    """
    syntax, problem = subject.domain.syntax, subject.domain.problem_syntax
    read = x.names_in(*map(x.conditions_of, syntax.schemas))
    read |= x.names_in(problem.goal, problem.metric) if problem else set()
    for _, effect in _changes(subject):
        read |= x.names_in(effect.value) - {effect.function.name}
    changed = x.changed_names(syntax.schemas)
    if problem is None and x.REWARD not in syntax.declarations:
        read |= changed
    for name, declaration in syntax.declarations.items():
        if name in read or name in (x.REWARD, x.UNSAFE, x.TERMINAL):
            continue
        what = "function" if declaration.numeric else "predicate"
        flags = "`(reward)` needs" if declaration.numeric else "`(unsafe)`, `(terminal)` need"
        text, advice = "declared, but nothing changes or reads it", ""
        if name in changed:
            text = "changed, but nothing reads it: no condition, no reward"
            advice = f"only {flags} no reader"
        yield DomainWarning(f"{what} `{name}` is {text}", declaration.place, advice=advice)


@rule("unused-parameter", local=True)
def _unused_parameter(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    for _, schema in _schemas(subject):
        for form in x.nodes_in(schema):
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
    for what, schema in _schemas(subject):
        for effect in x.nodes_in(schema.effects):
            if isinstance(effect, x.ChangeFunction):
                yield what, effect


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
                f"`{effect.place.text}` in {what} is `{opposite}`, because the number is negative",
                effect.place,
                advice=f"leave the minus out, or write `{opposite}`",
                fix=Fix((Edit(begin, begin + 1, ""),), sure=False),
            )


@rule("set-and-unset", local=True)
def _set_and_unset(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what one list of effects makes false and true: in PDDL, true wins."""
    for what, schema in _schemas(subject):
        inner = (e.effects for e in x.nodes_in(schema.effects)
                 if isinstance(e, x.When | x.ForallEffect))  # fmt: skip
        for effects in (schema.effects, *inner):
            settings = [effect for effect in effects if isinstance(effect, x.SetPredicate)]
            made = {x.meaning(effect.atom) for effect in settings if effect.value}
            for effect in settings:
                if not effect.value and x.meaning(effect.atom) in made:
                    yield DomainWarning(
                        f"`{effect.place.text}` in {what} comes to nothing: "
                        f"`{effect.atom.place.text}` is made true at the same time",
                        effect.place,
                    )
