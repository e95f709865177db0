"""Parsing whole domain and problem files."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Sequence

from serp._util.text import did_you_mean
from serp.pddl.conditions import parse_condition
from serp.pddl.contradictions import refuse_contradictions
from serp.pddl.declarations import (
    all_declarations,
    expect_group,
    expect_name,
    is_name,
    parse_objects,
    parse_parameters,
    parse_types,
)
from serp.pddl.effects import parse_effects
from serp.pddl.expressions import as_function, parse_expression, parse_number
from serp.pddl.scope import Scope
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.slips import several_under, written
from serp.pddl.source import DomainError, Place, Source
from serp.pddl.support import INSTEAD, check_requirements
from serp.pddl.syntax import (
    REWARD,
    TERMINAL,
    UNSAFE,
    Atom,
    Condition,
    Connective,
    DomainSyntax,
    FunctionTerm,
    Kind,
    Metric,
    Number,
    ProblemSyntax,
    Schema,
    SetPredicate,
    TotalTime,
)

_DOMAIN_ORDER = (":requirements", ":types", ":constants", ":predicates", ":functions")
_FIELDS = (":parameters", ":precondition", ":effect")
_KINDS = {":action": Kind.ACTION, ":process": Kind.PROCESS, ":event": Kind.EVENT}
_CONSTRAINT = ":constraint"
_FILE_NAME = re.compile(r"[a-z0-9][a-z0-9_.\-]*\Z")
_PROBLEM_SECTIONS = (":domain", ":requirements", ":objects", ":init", ":goal", ":metric")


def _definition(source: Source, what: str) -> tuple[str, Group, tuple[Group, ...]]:
    """Return the name, the whole, and the sections of `(define (what name) ...)`."""
    top = read_group(source)
    if top.head != "define":
        raise DomainError("a PDDL file begins with `(define`", top.place)
    title = expect_group(top.items[1], f"`({what} name)`") if len(top.items) > 1 else top
    if title is top or title.head not in ("domain", "problem"):
        raise DomainError(f"expected `({what} name)` after `define`", title.place)
    if title.head != what:
        raise DomainError(f"this is a {title.head} file, a {what} file is needed", title.place)
    name = _name(title, what)
    return name, top, tuple(expect_group(item, "a section") for item in top.items[2:])


def _name(title: Group, what: str) -> str:
    """Return the name in `(what name)`, with a warning where it is an unusual one.

    A domain's name becomes the name of files; that of a problem is read by nobody.
    """
    words = [node.text for node in title.items[1:] if isinstance(node, Word)]
    if what == "problem" and len(words) == len(title.items) - 1 and len(words) != 1:
        title.place.warn(f"`{title.place.text}`: other tools take one name")
        return " ".join(words)
    if len(title.items) != 2:
        raise DomainError(f"expected `({what} name)` after `define`", title.place)
    node = title.items[1]
    if isinstance(node, Word) and (what == "problem" or _FILE_NAME.match(node.text)):
        if not is_name(node):
            node.place.warn(f"`{node.text}`: for other tools a name begins with a letter and goes "
                            "on with letters, digits, `-` and `_`")  # fmt: skip
        return node.text
    return expect_name(node, f"the {what}").text


def parse_domain(source: Source) -> DomainSyntax:
    """Parse a domain file.

    Raises:
        DomainError: Anything in it is malformed, unknown or not supported.
    """
    name, top, sections = _definition(source, "domain")
    single: dict[str, Group] = {}
    schema_groups: list[Group] = []
    for section in sections:
        head = section.head
        if head in _KINDS or head == _CONSTRAINT:
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
    if ":requirements" in single:
        check_requirements(single[":requirements"])
    parents = parse_types(single[":types"]) if ":types" in single else {}
    constants = parse_objects(single[":constants"], parents) if ":constants" in single else {}
    declarations = all_declarations(single, parents)
    scope = Scope(parents, constants, declarations, {})
    schemas: dict[str, Schema] = {}
    for group in schema_groups:
        schema = _schema(group, scope)
        if schema.name in schemas:
            raise DomainError(
                f"`{schema.name}` is defined twice",
                group.items[1].place,
                "names of actions, processes and events must differ",
            )
        schemas[schema.name] = schema
    return DomainSyntax(name, parents, constants, declarations, tuple(schemas.values()), top.place)


def _schema(group: Group, scope: Scope) -> Schema:
    if group.head == _CONSTRAINT:
        return _constraint(group, scope)
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
    inner = Scope(
        scope.parents, scope.objects, scope.declarations, {}, in_process=kind is Kind.PROCESS
    ).bind(parameters)
    precondition = (
        parse_condition(fields[":precondition"], inner) if ":precondition" in fields else None
    )
    effects = parse_effects(fields[":effect"], inner) if ":effect" in fields else ()
    refuse_contradictions(effects)
    return Schema(kind, name, parameters, precondition, effects, group.place)


def _constraint(group: Group, scope: Scope) -> Schema:
    """Read `(:constraint NAME :parameters (...) :condition C)` as an event.

    It is how ENHSP writes what must hold in every state: a state where it does not is unsafe.
    """
    items = [item for item in group.items if not _is_word(item, ":parameters")]
    listed = items.pop(2) if len(items) == 5 and isinstance(items[2], Group) else None
    if len(items) != 4 or not _is_word(items[2], ":condition"):
        raise DomainError(
            "expected `(:constraint NAME :parameters (...) :condition CONDITION)`", group.place
        )
    name = expect_name(items[1], "the constraint").text
    parameters = (
        parse_parameters(listed.items, dict(scope.parents)) if isinstance(listed, Group) else ()
    )
    condition = parse_condition(items[3], scope.bind(parameters))
    group.place.warn(
        f"constraint `{name}` is read as an event that is `(unsafe)` where it is broken"
    )
    if condition is None:
        raise DomainError("a constraint without a condition", group.place)
    broken = Connective("not", (condition,), group.place)
    unsafe = SetPredicate(Atom(UNSAFE, (), group.place), True, group.place)
    return Schema(Kind.EVENT, name, parameters, broken, (unsafe,), group.place)


def _is_word(node: Node, text: str) -> bool:
    return isinstance(node, Word) and node.text == text


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


def parse_problem(source: Source, domain: DomainSyntax) -> ProblemSyntax:
    """Parse the problem file that belongs to a domain.

    Raises:
        DomainError: Anything in it is malformed, unknown, not supported, or of another domain.
    """
    name, top, sections = _definition(source, "problem")
    single: dict[str, Group] = {}
    for section in sections:
        if section.head not in _PROBLEM_SECTIONS:
            raise DomainError(
                f"`{section.head or '()'}` is not supported in a problem",
                section.place,
                INSTEAD.get(section.head) or did_you_mean(section.head, _PROBLEM_SECTIONS),
            )
        if section.head in single:
            raise DomainError(f"a second `{section.head}`", section.place, "merge the two")
        single[section.head] = section
    if ":domain" in single:
        _check_domain_name(single[":domain"], domain)
    if ":requirements" in single:
        check_requirements(single[":requirements"])
    objects = dict(domain.constants)
    if ":objects" in single:
        for obj in parse_objects(single[":objects"], domain.parents).values():
            known = objects.get(obj.name)
            if known is not None and known.type != obj.type:
                raise DomainError(
                    f"`{obj.name}` is a constant of type `{known.type}` in the domain", obj.place
                )
            objects[obj.name] = obj
    scope = Scope(domain.parents, objects, domain.declarations, {})
    atoms, values = _initial(single[":init"], scope) if ":init" in single else ((), ())
    goal = _goal(single[":goal"], scope) if ":goal" in single else None
    metric = _metric(single[":metric"], scope) if ":metric" in single else None
    return ProblemSyntax(
        name, objects, atoms, values, goal, metric, top.place, has_init=":init" in single
    )


def _check_domain_name(group: Group, domain: DomainSyntax) -> None:
    if len(group.items) != 2:
        raise DomainError("expected `(:domain name)`", group.place)
    word = group.items[1]
    if not isinstance(word, Word):
        raise DomainError("expected the name of the domain, found a list", word.place)
    if word.text != domain.name:
        word.place.warn(f"this problem names domain `{word.text}`, not `{domain.name}`")


def _initial(
    group: Group, scope: Scope
) -> tuple[tuple[Atom, ...], tuple[tuple[FunctionTerm, Number], ...]]:
    atoms: list[Atom] = []
    denied: dict[tuple[str, ...], Place] = {}
    values: dict[tuple[str, ...], tuple[FunctionTerm, Number]] = {}
    # What a metric may read, an initial value may name: `(reward)` too.
    readable = Scope(scope.parents, scope.objects, scope.declarations, {}, in_metric=True)
    for node in group.items[1:]:
        item = expect_group(node, "a fact")
        if item.head == "=":
            if len(item.items) != 3:
                raise DomainError("expected `(= (function) number)`", item.place)
            target = expect_group(as_function(item.items[1], scope), "a function")
            function = parse_expression(target, readable)
            if isinstance(function, TotalTime) and parse_number(item.items[2]).value == 0.0:
                item.place.warn("`(total-time)` starts at 0 without being told so")
                continue
            if not isinstance(function, FunctionTerm):
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
            if not isinstance(fact, Atom):
                raise DomainError("`not` takes one predicate", item.place)
            denied[_key(fact)] = item.place  # false anyway, unless it is stated too
            continue
        if item.head == "at" and len(item.items) == 3 and isinstance(item.items[2], Group):
            raise DomainError(
                "timed initial literals are not supported", item.place, INSTEAD["timed"]
            )
        fact = parse_condition(item, scope)
        if not isinstance(fact, Atom):
            raise DomainError(
                "expected a predicate over objects or `(= (function) number)`", item.place
            )
        if fact.name in (UNSAFE, TERMINAL):
            raise DomainError(f"`({fact.name})` starts false in every step", item.place)
        atoms.append(fact)
    for atom in atoms:
        if _key(atom) in denied:
            raise DomainError(f"`{atom.place.text}` is also stated true", denied[_key(atom)])
    _, zero = values.pop((REWARD,), (None, None))
    if zero is not None and zero.value != 0.0:
        raise DomainError("`(reward)` starts at 0 in every step", zero.place)
    return tuple(atoms), tuple(values.values())


def _key(term: Atom | FunctionTerm) -> tuple[str, ...]:
    return (term.name, *(argument.name for argument in term.arguments))


def _goal(group: Group, scope: Scope) -> Condition | None:
    if len(group.items) != 2:
        raise DomainError("expected `(:goal condition)`", group.place)
    return parse_condition(group.items[1], scope)


def _metric(group: Group, scope: Scope) -> Metric:
    if len(group.items) != 3 or not isinstance(group.items[1], Word):
        raise DomainError("expected `(:metric maximize|minimize expression)`", group.place)
    sense = group.items[1]
    if sense.text not in ("maximize", "minimize"):
        raise DomainError(f"expected maximize or minimize, found `{sense.text}`", sense.place)
    inner = Scope(scope.parents, scope.objects, scope.declarations, {}, in_metric=True)
    node = group.items[2]
    return Metric(sense.text == "maximize", parse_expression(node, inner), group.place)
