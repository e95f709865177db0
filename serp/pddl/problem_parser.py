"""Parsing problem files."""

from __future__ import annotations

from dataclasses import replace

from serp.pddl import syntax as x
from serp.pddl.conditions import parse_condition
from serp.pddl.declarations import expect_group, parse_objects
from serp.pddl.definition import (
    add_section,
    read_definition,
    read_requirements,
    unknown_section,
)
from serp.pddl.expressions import as_function, parse_expression, parse_number
from serp.pddl.scope import INSTEAD, Scope
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError, Place, Source

_SECTIONS = (":domain", ":requirements", ":objects", ":init", ":goal", ":metric")


def parse_problem(source: Source, domain: x.DomainSyntax) -> x.ProblemSyntax:
    """Parse the problem file that belongs to a domain, like `parse_domain`."""
    name, top, sections = read_definition(source, "problem")
    single: dict[str, Group] = {}
    for section in sections:
        with section.place.recovering():
            if section.head not in _SECTIONS:
                raise unknown_section(section, _SECTIONS, "problem")
            add_section(section, single)
    if ":domain" in single:
        with source.recovering():
            _check_domain_name(single[":domain"], domain)
    requirements = domain.requirements | read_requirements(single.get(":requirements"))
    objects = dict(domain.constants)
    if listed := single.get(":objects"):
        with listed.place.recovering():
            objects |= _objects(listed, domain)
    math = x.MATH_REQUIREMENT in requirements
    scope = Scope(domain.parents, objects, domain.declarations, {}, math=math, declares=":objects")
    atoms, values = _initial(single[":init"], scope) if ":init" in single else ((), ())
    init = single[":init"].place if ":init" in single else None
    goal: x.Condition | None = None
    metric: x.Metric | None = None
    if ":goal" in single:
        with source.recovering():
            goal = _goal(single[":goal"], scope)
    if ":metric" in single:
        with source.recovering():
            metric = _metric(single[":metric"], scope)
    return x.ProblemSyntax(name, objects, atoms, values, goal, metric, top.place, init)


def _objects(group: Group, domain: x.DomainSyntax) -> dict[str, x.ObjectDeclaration]:
    objects = parse_objects(group, domain.parents)
    for declared in objects.values():
        known = domain.constants.get(declared.name)
        if known is not None and known.type != declared.type:
            raise DomainError(
                f"`{declared.name}` is a constant of type `{known.type}` in the domain",
                declared.place,
                code="declared-twice",
            )
    return objects


def _check_domain_name(group: Group, domain: x.DomainSyntax) -> None:
    if len(group.items) != 2:
        raise DomainError("expected `(:domain name)`", group.place)
    word = group.items[1]
    if not isinstance(word, Word):
        raise DomainError("expected the name of the domain, found a list", word.place)
    if word.text != domain.name:
        text = f"this problem names domain `{word.text}`, not `{domain.name}`"
        word.place.warn(text, "other-domain", write=domain.name)


class _Initial:
    """The facts of an `:init`, as they are read."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        # What a metric may read, an initial value may name: `(reward)` too.
        self._readable = replace(scope, in_metric=True)
        self.atoms: list[x.Atom] = []
        self.denied: dict[tuple[str, ...], Place] = {}
        self.values: dict[tuple[str, ...], tuple[x.FunctionTerm, x.Number]] = {}

    def add(self, node: Node) -> None:
        item = expect_group(node, "a fact")
        if item.head == "=":
            self._add_value(item)
        elif item.head == "not":
            fact = parse_condition(item.items[1], self._scope) if len(item.items) == 2 else None
            if not isinstance(fact, x.Atom):
                raise DomainError("`not` takes one predicate", item.place)
            self.denied[_key(fact)] = item.place  # false anyway, unless it is stated too
        else:
            self._add_fact(item)

    def _add_value(self, item: Group) -> None:
        if len(item.items) != 3:
            raise DomainError("expected `(= (function) number)`", item.place)
        target = expect_group(as_function(item.items[1], self._scope), "a function")
        function = parse_expression(target, self._readable)
        if isinstance(function, x.TotalTime) and parse_number(item.items[2]).value == 0.0:
            text = "`(total-time)` always starts at 0; leave this out"
            item.place.warn(text, "needless", write="")
            return
        if not isinstance(function, x.FunctionTerm):
            raise DomainError("expected a function of the domain", function.place)
        key = _key(function)
        if key in self.values:
            raise DomainError(
                f"a second value for `{function.place.text}`", item.place, code="declared-twice"
            )
        value = parse_number(item.items[2])
        if function.name == x.REWARD and value.value != 0.0:
            problem = "`(reward)` starts at 0 in every step"
            raise DomainError(problem, value.place, code="reserved-use")
        self.values[key] = (function, value)

    def _add_fact(self, item: Group) -> None:
        if item.head == "at" and len(item.items) == 3 and isinstance(item.items[2], Group):
            raise DomainError(
                "timed initial literals are not supported",
                item.place,
                INSTEAD["timed"],
                code="unsupported",
            )
        if item.head in ("oneof", "or", "unknown", "probabilistic") and (
            item.head not in self._scope.declarations
        ):
            raise DomainError(
                f"`{item.head}` is not supported in `:init`",
                item.place.opening,
                INSTEAD["unknown"],
                code="unsupported",
            )
        fact = parse_condition(item, self._scope)
        if not isinstance(fact, x.Atom):
            raise DomainError(
                "expected a predicate over objects or `(= (function) number)`",
                item.place,
                "list facts one after the other, without `and`" if item.head == "and" else "",
            )
        if fact.name in (x.UNSAFE, x.TERMINAL):
            raise DomainError(
                f"`({fact.name})` starts false in every step", item.place, code="reserved-use"
            )
        self.atoms.append(fact)


def _initial(
    group: Group, scope: Scope
) -> tuple[tuple[x.Atom, ...], tuple[tuple[x.FunctionTerm, x.Number], ...]]:
    initial = _Initial(scope)
    for node in group.items[1:]:
        with group.place.source.recovering():
            initial.add(node)
    for atom in initial.atoms:
        if (denied := initial.denied.get(_key(atom))) is not None:
            with group.place.source.recovering():
                problem = f"`{atom.place.text}` is also stated true"
                raise DomainError(problem, denied, code="declared-twice")
    initial.values.pop((x.REWARD,), None)
    return tuple(initial.atoms), tuple(initial.values.values())


def _key(term: x.Atom | x.FunctionTerm) -> tuple[str, ...]:
    return (term.name, *(argument.name for argument in term.arguments))


def _goal(group: Group, scope: Scope) -> x.Condition | None:
    if len(group.items) != 2:
        raise DomainError("expected `(:goal condition)`", group.place)
    taken = group.place.source.errors_taken
    goal = parse_condition(group.items[1], scope)
    return goal if group.place.source.errors_taken == taken else None


def _metric(group: Group, scope: Scope) -> x.Metric:
    if len(group.items) != 3 or not isinstance(group.items[1], Word):
        raise DomainError("expected `(:metric maximize|minimize expression)`", group.place)
    sense = group.items[1]
    if sense.text not in ("maximize", "minimize"):
        raise DomainError(f"expected maximize or minimize, found `{sense.text}`", sense.place)
    expression = parse_expression(group.items[2], replace(scope, in_metric=True))
    return x.Metric(sense.text == "maximize", expression, group.place)
