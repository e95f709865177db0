"""Parsing domain files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

from serp._util.text import closest
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
from serp.pddl.definition import (
    add_section,
    read_definition,
    read_requirements,
    unknown_section,
)
from serp.pddl.effects import parse_effects
from serp.pddl.scope import INSTEAD, Scope
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.slips import several_under, written
from serp.pddl.source import DomainError, Source

_DOMAIN_ORDER = (":requirements", ":types", ":constants", ":predicates", ":functions")
_FIELDS = (":parameters", ":precondition", ":effect")
_RESERVED = {
    x.REWARD: "is what a step gains",
    x.UNSAFE: "flags what does damage",
    x.TERMINAL: "ends the task",
}
"""Reserved name → what it means."""
_KINDS = {":action": x.Kind.ACTION, ":process": x.Kind.PROCESS, ":event": x.Kind.EVENT}


def parse_domain(source: Source) -> x.DomainSyntax:
    """Parse a domain file; where the source has a `recovery`, all of it that can be understood."""
    name, top, sections = read_definition(source, "domain")
    single: dict[str, Group] = {}
    schema_groups: list[Group] = []
    for section in sections:
        if section.head in _KINDS:
            schema_groups.append(section)
        else:
            with section.place.recovering():
                if section.head not in _DOMAIN_ORDER:
                    raise unknown_section(section, [*_DOMAIN_ORDER, *_KINDS], "domain")
                add_section(section, single)
    requirements = read_requirements(single.get(":requirements"))
    scope = _declared(single, math=x.MATH_REQUIREMENT in requirements)
    names: set[str] = set()
    schemas: list[x.Schema] = []
    for group in schema_groups:
        with group.place.source.recovering():
            schema = _schema(group, scope, names)
            if schema is not None:
                schemas.append(schema)
    return x.DomainSyntax(
        name,
        dict(scope.parents),
        dict(scope.objects),
        dict(scope.declarations),
        tuple(schemas),
        requirements,
        top.place,
    )


def _declared(single: dict[str, Group], *, math: bool) -> Scope:
    """Return the scope of what the sections before the schemas declare."""
    parents: dict[str, str] = {}
    constants: dict[str, x.ObjectDeclaration] = {}
    if types := single.get(":types"):
        with types.place.recovering():
            parents = parse_types(types)
    if objects := single.get(":constants"):
        with objects.place.recovering():
            constants = parse_objects(objects, parents)
    declarations = _all_declarations(single, parents)
    for declaration in declarations.values() if math else ():
        if declaration.numeric and declaration.name in x.MATH_FUNCTIONS:
            declaration.place.warn(
                f"`({declaration.name} ...)` means this function, not that of "
                f"`{x.MATH_REQUIREMENT}`; rename it to use both",
                "hidden-function",
            )
    return Scope(parents, constants, declarations, {}, math=math)


def _all_declarations(
    single: dict[str, Group], parents: dict[str, str]
) -> dict[str, x.Declaration]:
    declarations: dict[str, x.Declaration] = {}
    for head in (h for h in single if h in (":predicates", ":functions")):
        numeric = head == ":functions"
        for name, declaration in parse_declarations(single[head], parents, numeric=numeric).items():
            with declaration.place.recovering():
                if name in declarations:
                    raise DomainError(
                        f"`{name}` is both a predicate and a function",
                        declaration.place,
                        code="declared-twice",
                    )
                _check_reserved(declaration)
                declarations[name] = declaration
    return declarations


def _check_reserved(declaration: x.Declaration) -> None:
    name = declaration.name
    numeric = {x.REWARD: True, x.UNSAFE: False, x.TERMINAL: False}.get(name)
    if numeric is None:
        return
    if declaration.numeric != numeric:
        kind = "function" if numeric else "predicate"
        problem = f"`({name})` is reserved and must be a {kind}"
    elif declaration.parameters:
        problem = f"`({name})` is reserved and takes no parameters"
    else:
        return
    advice = f"it {_RESERVED[name]}; where you mean something else, choose another name"
    raise DomainError(problem, declaration.place, advice, code="reserved-name")


def _schema(group: Group, scope: Scope, names: set[str]) -> x.Schema | None:
    """Parse an action, a process or an event; None where errors in it were taken.

    Its name joins `names`, those of the schemas before it.
    """
    kind, source = _KINDS[group.head], group.place.source
    taken = source.errors_taken
    if len(group.items) < 2:
        raise DomainError(f"`{group.head}` without a name", group.place)
    name = expect_name(group.items[1], f"the {kind.value}").text
    with source.recovering():
        if name in names:
            raise DomainError(
                f"`{name}` is defined twice",
                group.items[1].place,
                "names of actions, processes and events must differ",
                code="declared-twice",
            )
    names.add(name)
    fields = _fields(group, f"{kind.value} `{name}`")
    parameters: tuple[x.SchemaParameter, ...] = ()
    precondition: x.Condition | None = None
    effects: tuple[x.Effect, ...] = ()
    if listed := fields.get(":parameters"):
        with listed.place.recovering():
            parameters = parse_parameters(listed.items, dict(scope.parents))
    inner = replace(scope, in_process=kind is x.Kind.PROCESS).bind(parameters)
    if condition := fields.get(":precondition"):
        with source.recovering():
            precondition = parse_condition(condition, inner)
    if effect := fields.get(":effect"):
        with source.recovering():
            effects = parse_effects(effect, inner)
            refuse_contradictions(effects)
    if source.errors_taken > taken:
        return None
    return x.Schema(kind, name, parameters, precondition, effects, group.place)


def _fields(group: Group, schema: str) -> dict[str, Group]:
    """Return what `:parameters`, `:precondition` and `:effect` of a schema say."""
    fields: dict[str, Group] = {}
    rest = group.items[2:]
    index = 0
    while index < len(rest):
        key, begin = rest[index], index
        index = _next_field(rest, begin + 1)  # where an error leads
        with key.place.recovering():
            if not isinstance(key, Word) or key.text not in _FIELDS:
                raise _no_field(rest[:begin], key, rest[begin:], schema)
            if key.text in fields:
                raise DomainError(
                    f"a second `{key.text}` in {schema}", key.place, code="declared-twice"
                )
            if begin + 1 == len(rest):
                raise DomainError(f"`{key.text}` without a value", key.place, code="missing-value")
            fields[key.text] = expect_group(rest[begin + 1], f"the value of `{key.text}`")
            index = begin + 2
    return fields


def _next_field(rest: Sequence[Node], begin: int) -> int:
    """Return where the next field begins, or the end."""
    return next(
        (k for k in range(begin, len(rest)) if getattr(rest[k], "text", "").startswith(":")),
        len(rest),
    )


def _no_field(before: Sequence[Node], node: Node, rest: Sequence[Node], schema: str) -> DomainError:
    """Return what is wrong where `:parameters`, `:precondition` or `:effect` is expected."""
    key = before[-2] if len(before) > 1 else None
    if isinstance(node, Group):
        if isinstance(key, Word) and key.text != ":parameters" and node.head not in _FIELDS:
            several = itertools.takewhile(lambda item: isinstance(item, Group), rest)
            return several_under(key.text, [before[-1], *several])
        write = written(node)[1:-1] if node.head in _FIELDS else None
    else:
        write = closest(node.text, _FIELDS)
    instead = INSTEAD.get(node.text) if isinstance(node, Word) else None
    return DomainError(
        f"`{node.place.text}` is not supported in {schema}",
        node.place,
        instead or "expected :parameters, :precondition and :effect",
        write=None if instead else write,
        code="unsupported" if instead else "unknown-field",
    )
