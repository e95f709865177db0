"""Parsing domain files."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Sequence
from dataclasses import replace

from serp._util.text import did_you_mean
from serp.pddl import syntax as x
from serp.pddl.conditions import parse_condition
from serp.pddl.contradictions import refuse_contradictions
from serp.pddl.declarations import (
    expect_group,
    expect_name,
    parse_declarations,
    parse_objects,
    parse_parameters,
    parse_types,
)
from serp.pddl.definition import read_definition, read_requirements
from serp.pddl.effects import parse_effects
from serp.pddl.scope import INSTEAD, Scope
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.slips import several_under, written
from serp.pddl.source import DomainError, Source

_DOMAIN_ORDER = (":requirements", ":types", ":constants", ":predicates", ":functions")
_FIELDS = (":parameters", ":precondition", ":effect")
_KINDS = {":action": x.Kind.ACTION, ":process": x.Kind.PROCESS, ":event": x.Kind.EVENT}


def parse_domain(source: Source) -> x.DomainSyntax:
    """Parse a domain file."""
    name, top, sections = read_definition(source, "domain")
    single: dict[str, Group] = {}
    schema_groups: list[Group] = []
    for section in sections:
        head = section.head
        if head in _KINDS:
            schema_groups.append(section)
        elif head in _DOMAIN_ORDER:
            if head in single:
                raise DomainError(f"a second `{head}`", section.place, "merge the two")
            single[head] = section
        else:
            advice = INSTEAD.get(head) or did_you_mean(head, [*_DOMAIN_ORDER, *_KINDS])
            raise DomainError(
                f"`{head or '()'}` is not supported in a domain", section.place, advice
            )
    requirements = read_requirements(single.get(":requirements"))
    math = x.MATH_REQUIREMENT in requirements
    parents = parse_types(single[":types"]) if ":types" in single else {}
    constants = parse_objects(single[":constants"], parents) if ":constants" in single else {}
    declarations = _all_declarations(single, parents)
    for declaration in declarations.values() if math else ():
        if declaration.numeric and declaration.name in x.MATH_FUNCTIONS:
            declaration.place.warn(
                f"`({declaration.name} ...)` means this function, not that of "
                f"`{x.MATH_REQUIREMENT}`; rename it to use both"
            )
    scope = Scope(parents, constants, declarations, {}, math=math)
    schemas: dict[str, x.Schema] = {}
    for group in schema_groups:
        schema = _schema(group, scope)
        if schema.name in schemas:
            raise DomainError(
                f"`{schema.name}` is defined twice",
                group.items[1].place,
                "names of actions, processes and events must differ",
            )
        schemas[schema.name] = schema
    return x.DomainSyntax(
        name, parents, constants, declarations, tuple(schemas.values()), requirements, top.place
    )


def _all_declarations(
    single: dict[str, Group], parents: dict[str, str]
) -> dict[str, x.Declaration]:
    declarations: dict[str, x.Declaration] = {}
    for head in (h for h in single if h in (":predicates", ":functions")):
        numeric = head == ":functions"
        for name, declaration in parse_declarations(single[head], parents, numeric=numeric).items():
            if name in declarations:
                raise DomainError(f"`{name}` is both a predicate and a function", declaration.place)
            declarations[name] = declaration
    for name, numeric in ((x.REWARD, True), (x.UNSAFE, False), (x.TERMINAL, False)):
        reserved = declarations.get(name)
        if reserved is None:
            continue
        if reserved.numeric != numeric:
            kind = "function" if numeric else "predicate"
            raise DomainError(f"`({name})` is reserved and must be a {kind}", reserved.place)
        if reserved.parameters:
            raise DomainError(f"`({name})` is reserved and takes no parameters", reserved.place)
    return declarations


def _schema(group: Group, scope: Scope) -> x.Schema:
    kind = _KINDS[group.head]
    if len(group.items) < 2:
        raise DomainError(f"`{group.head}` without a name", group.place)
    name = expect_name(group.items[1], f"the {kind.value}").text
    fields: dict[str, Group] = {}
    rest = group.items[2:]
    for index in range(0, len(rest), 2):
        key = rest[index]
        if not isinstance(key, Word) or key.text not in _FIELDS:
            raise _no_field(rest[:index], key, rest[index:], f"{kind.value} `{name}`")
        if key.text in fields:
            raise DomainError(f"a second `{key.text}` in {kind.value} `{name}`", key.place)
        if index + 1 == len(rest):
            raise DomainError(f"`{key.text}` without a value", key.place)
        fields[key.text] = expect_group(rest[index + 1], f"the value of `{key.text}`")
    listed = fields[":parameters"].items if ":parameters" in fields else ()
    parameters = parse_parameters(listed, dict(scope.parents))
    inner = replace(scope, in_process=kind is x.Kind.PROCESS).bind(parameters)
    precondition = (
        parse_condition(fields[":precondition"], inner) if ":precondition" in fields else None
    )
    effects = parse_effects(fields[":effect"], inner) if ":effect" in fields else ()
    refuse_contradictions(effects)
    return x.Schema(kind, name, parameters, precondition, effects, group.place)


def _no_field(before: Sequence[Node], node: Node, rest: Sequence[Node], schema: str) -> DomainError:
    """Return what is wrong where `:parameters`, `:precondition` or `:effect` is expected."""
    key = before[-2] if before else None
    if isinstance(node, Group):
        if isinstance(key, Word) and key.text != ":parameters" and node.head not in _FIELDS:
            several = itertools.takewhile(lambda item: isinstance(item, Group), rest)
            return several_under(key.text, [before[-1], *several])
        write = written(node)[1:-1] if node.head in _FIELDS else None
    else:
        close = difflib.get_close_matches(node.text, _FIELDS, n=1)
        write = close[0] if close else None
    return DomainError(
        f"`{node.place.text}` is not supported in {schema}",
        node.place,
        "expected :parameters, :precondition and :effect",
        write=write,
    )
