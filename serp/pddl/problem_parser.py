"""Parsing problem files."""

from __future__ import annotations

from dataclasses import replace

from serp._util.text import did_you_mean
from serp.pddl import syntax as x
from serp.pddl.conditions import parse_condition
from serp.pddl.declarations import expect_group, parse_objects
from serp.pddl.definition import read_definition, read_requirements
from serp.pddl.expressions import as_function, parse_expression, parse_number
from serp.pddl.scope import INSTEAD, Scope
from serp.pddl.sexpr import Group, Word
from serp.pddl.source import DomainError, Place, Source

_SECTIONS = (":domain", ":requirements", ":objects", ":init", ":goal", ":metric")


def parse_problem(source: Source, domain: x.DomainSyntax) -> x.ProblemSyntax:
    """Parse the problem file that belongs to a domain."""
    name, top, sections = read_definition(source, "problem")
    single: dict[str, Group] = {}
    for section in sections:
        if section.head not in _SECTIONS:
            raise DomainError(
                f"`{section.head or '()'}` is not supported in a problem",
                section.place,
                INSTEAD.get(section.head) or did_you_mean(section.head, _SECTIONS),
            )
        if section.head in single:
            raise DomainError(f"a second `{section.head}`", section.place, "merge the two")
        single[section.head] = section
    if ":domain" in single:
        _check_domain_name(single[":domain"], domain)
    requirements = domain.requirements | read_requirements(single.get(":requirements"))
    objects = dict(domain.constants)
    if ":objects" in single:
        for obj in parse_objects(single[":objects"], domain.parents).values():
            known = objects.get(obj.name)
            if known is not None and known.type != obj.type:
                raise DomainError(
                    f"`{obj.name}` is a constant of type `{known.type}` in the domain", obj.place
                )
            objects[obj.name] = obj
    math = x.MATH_REQUIREMENT in requirements
    scope = Scope(domain.parents, objects, domain.declarations, {}, math=math)
    atoms, values = _initial(single[":init"], scope) if ":init" in single else ((), ())
    goal = _goal(single[":goal"], scope) if ":goal" in single else None
    metric = _metric(single[":metric"], scope) if ":metric" in single else None
    return x.ProblemSyntax(
        name, objects, atoms, values, goal, metric, top.place, has_init=":init" in single
    )


def _check_domain_name(group: Group, domain: x.DomainSyntax) -> None:
    if len(group.items) != 2:
        raise DomainError("expected `(:domain name)`", group.place)
    word = group.items[1]
    if not isinstance(word, Word):
        raise DomainError("expected the name of the domain, found a list", word.place)
    if word.text != domain.name:
        word.place.warn(f"this problem names domain `{word.text}`, not `{domain.name}`")


def _initial(
    group: Group, scope: Scope
) -> tuple[tuple[x.Atom, ...], tuple[tuple[x.FunctionTerm, x.Number], ...]]:
    atoms: list[x.Atom] = []
    denied: dict[tuple[str, ...], Place] = {}
    values: dict[tuple[str, ...], tuple[x.FunctionTerm, x.Number]] = {}
    # What a metric may read, an initial value may name: `(reward)` too.
    readable = replace(scope, in_metric=True)
    for node in group.items[1:]:
        item = expect_group(node, "a fact")
        if item.head == "=":
            if len(item.items) != 3:
                raise DomainError("expected `(= (function) number)`", item.place)
            target = expect_group(as_function(item.items[1], scope), "a function")
            function = parse_expression(target, readable)
            if isinstance(function, x.TotalTime) and parse_number(item.items[2]).value == 0.0:
                item.place.warn("`(total-time)` always starts at 0; leave this out")
                continue
            if not isinstance(function, x.FunctionTerm):
                raise DomainError("expected a function of the domain", function.place)
            key = _key(function)
            if key in values:
                raise DomainError(f"a second value for `{function.place.text}`", item.place)
            values[key] = (function, parse_number(item.items[2]))
            continue
        if item.head == "not":
            if len(item.items) != 2:
                raise DomainError("`not` takes one predicate", item.place)
            fact = parse_condition(item.items[1], scope)
            if not isinstance(fact, x.Atom):
                raise DomainError("`not` takes one predicate", item.place)
            denied[_key(fact)] = item.place  # false anyway, unless it is stated too
            continue
        if item.head == "at" and len(item.items) == 3 and isinstance(item.items[2], Group):
            raise DomainError(
                "timed initial literals are not supported", item.place, INSTEAD["timed"]
            )
        fact = parse_condition(item, scope)
        if not isinstance(fact, x.Atom):
            raise DomainError(
                "expected a predicate over objects or `(= (function) number)`", item.place
            )
        if fact.name in (x.UNSAFE, x.TERMINAL):
            raise DomainError(f"`({fact.name})` starts false in every step", item.place)
        atoms.append(fact)
    for atom in atoms:
        if _key(atom) in denied:
            raise DomainError(f"`{atom.place.text}` is also stated true", denied[_key(atom)])
    _, zero = values.pop((x.REWARD,), (None, None))
    if zero is not None and zero.value != 0.0:
        raise DomainError("`(reward)` starts at 0 in every step", zero.place)
    return tuple(atoms), tuple(values.values())


def _key(term: x.Atom | x.FunctionTerm) -> tuple[str, ...]:
    return (term.name, *(argument.name for argument in term.arguments))


def _goal(group: Group, scope: Scope) -> x.Condition | None:
    if len(group.items) != 2:
        raise DomainError("expected `(:goal condition)`", group.place)
    return parse_condition(group.items[1], scope)


def _metric(group: Group, scope: Scope) -> x.Metric:
    if len(group.items) != 3 or not isinstance(group.items[1], Word):
        raise DomainError("expected `(:metric maximize|minimize expression)`", group.place)
    sense = group.items[1]
    if sense.text not in ("maximize", "minimize"):
        raise DomainError(f"expected maximize or minimize, found `{sense.text}`", sense.place)
    expression = parse_expression(group.items[2], replace(scope, in_metric=True))
    return x.Metric(sense.text == "maximize", expression, group.place)
