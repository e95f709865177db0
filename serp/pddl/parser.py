"""Parsing domain and problem files."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

from serp._util.did_you_mean import closest, did_you_mean
from serp.pddl import syntax as x
from serp.pddl.expressions import (
    as_function,
    parse_condition,
    parse_effects,
    parse_expression,
    parse_number,
    refuse_contradictions,
)
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.scope import (
    INSTEAD,
    RESERVED_WORDS,
    TOTAL_TIME,
    Scope,
    declared_as,
    expect_group,
    expect_name,
    is_name,
    parse_declarations,
    parse_objects,
    parse_parameters,
    parse_types,
    unsupported,
)
from serp.pddl.slips import several, written
from serp.pddl.source import DomainError, Place, Source
from serp.pddl.syntax import MATH_REQUIREMENT

SUPPORTED_REQUIREMENTS = frozenset(
    (
        *(":strips", ":typing", ":equality", ":adl", ":conditional-effects"),
        *(":negative-preconditions", ":disjunctive-preconditions", ":quantified-preconditions"),
        *(":existential-preconditions", ":universal-preconditions"),
        *(":fluents", ":numeric-fluents", ":action-costs"),
        *(":probabilistic-effects", ":non-deterministic", ":rewards", ":mdp"),
        *(":derived-predicates", ":domain-axioms", ":subgoal-through-axioms"),
        *(":time", ":processes", ":events", ":continuous-effects", ":hybrid", MATH_REQUIREMENT),
    )
)
"""What a file may list under `:requirements`."""
_T = TypeVar("_T")
_FILE_NAME = re.compile(r"[a-z0-9][a-z0-9_.\-]*\Z")


class _Definition(NamedTuple):
    """`(define (what name) ...)`: its sections, those of schemas by themselves."""

    name: str
    place: Place
    sections: dict[str, Group]
    schemas: list[Group]
    axioms: list[Group]


def _definition(source: Source, what: str, known: Sequence[str]) -> _Definition:
    """Read a file, which has each of the `known` sections but those of schemas once."""
    top = read_group(source)
    if top.head != "define":
        raise DomainError("a PDDL file must begin with `(define`", top.place)
    title = expect_group(top.items[1], f"`({what} name)`") if len(top.items) > 1 else top
    if title is top or title.head not in ("domain", "problem"):
        raise DomainError(f"expected `({what} name)` after `define`", title.place)
    if title.head != what:
        raise DomainError(f"this is a {title.head} file, but a {what} file is needed", title.place)
    definition = _Definition(_name(title, what), top.place, {}, [], [])
    for item in top.items[2:]:
        with item.place.recovering():
            section = expect_group(item, "a section")
            head = section.head
            if head not in known:
                raise _unknown_section(section, known, what)
            if head in SCHEMA_SECTIONS:
                definition.schemas.append(section)
            elif head == DERIVED:
                definition.axioms.append(section)
            elif head in definition.sections:
                raise DomainError(
                    f"a second `{head}`", section.place, "merge the two", code="declared-twice"
                )
            else:
                definition.sections[head] = section
    return definition


def _said(
    group: Group | None, parse: Callable[[Group], _T], otherwise: _T, *, declares: bool = False
) -> _T:
    """Return what a section or a field says, or something else where it is missing or wrong.

    Names in one that `declares` some are not reported as unknown if it is wrong.
    """
    if group is not None:
        with group.place.source.recovering(group.place if declares else None):
            return parse(group)
    return otherwise


def _name(title: Group, what: str) -> str:
    """Return the name in `(what name)`, with a warning where it is an unusual one.

    A domain's name becomes part of file names; a problem's name is not used.
    """
    words = [node for node in title.items[1:] if isinstance(node, Word)]
    if what == "problem" and len(words) == len(title.items) - 1 != 1:
        title.place.warn(f"`{title.place.text}`: other tools expect a single name")
        return " ".join(word.text for word in words)
    if len(title.items) != 2:
        raise DomainError(f"expected `({what} name)` after `define`", title.place)
    if words and not is_name(words[0]) and (what == "problem" or _FILE_NAME.match(words[0].text)):
        words[0].place.warn(f"`{words[0].text}`: other tools expect a name that begins with a "
                            "letter, followed by letters, digits, `-` and `_`")  # fmt: skip
        return words[0].text
    return expect_name(title.items[1], f"the {what}").text


def _requirements(group: Group | None) -> frozenset[str]:
    """Return what `:requirements` lists.

    It warns of what is unknown or not supported; what needs that is refused itself.
    """
    listed: set[str] = set()
    for node in group.items[1:] if group is not None else ():
        if not isinstance(node, Word):
            raise DomainError("expected a requirement such as `:typing`", node.place)
        if (instead := INSTEAD.get(node.text)) is not None:
            text = f"requirement `{node.text}` is not supported"
            node.place.warn(text, "unknown-requirement", advice=instead)
        elif node.text not in SUPPORTED_REQUIREMENTS:
            advice = did_you_mean(node.text, SUPPORTED_REQUIREMENTS)
            text = f"requirement `{node.text}` is unknown; {advice}"
            node.place.warn(text, "unknown-requirement")
        listed.add(node.text)
    return frozenset(listed)


def _unknown_section(section: Group, known: Sequence[str], what: str) -> DomainError:
    """Return the error of a section that a `domain` or a `problem` does not have."""
    head = section.head
    place = section.items[0].place if head else section.place
    instead = INSTEAD.get(head)
    return DomainError(
        f"`{head or '()'}` is not supported in a {what}",
        place,
        instead or did_you_mean(head, known),
        guess=None if instead else closest(head, known),
        code="unsupported" if instead else "unknown-section",
    )


DERIVED = ":derived"
DOMAIN_SECTIONS = (":requirements", ":types", ":constants", ":predicates", ":functions")
SCHEMA_FIELDS = (":parameters", ":vars", ":precondition", ":effect")
SCHEMA_SECTIONS = {":action": x.Kind.ACTION, ":process": x.Kind.PROCESS, ":event": x.Kind.EVENT}


def parse_domain(source: Source) -> x.DomainSyntax:
    """Parse a domain file; where the source has a `recovery`, all of it that can be understood."""
    definition = _definition(source, "domain", (*DOMAIN_SECTIONS, DERIVED, *SCHEMA_SECTIONS))
    sections = definition.sections
    requirements = _requirements(sections.get(":requirements"))
    parents: dict[str, str] = _said(sections.get(":types"), parse_types, {}, declares=True)
    constants: dict[str, x.ObjectDeclaration] = _said(
        sections.get(":constants"), lambda group: parse_objects(group, parents), {}, declares=True
    )
    declarations: dict[str, x.Declaration] = {}
    for head, section in sections.items():
        if head in (":predicates", ":functions"):
            parse_declarations(section, parents, declarations, numeric=head == ":functions")
    if requirements & {":rewards", ":mdp"}:  # PPDDL has `(reward)` without a declaration
        reward = x.Declaration(x.REWARD, (), True, sections[":requirements"].place)
        declarations.setdefault(x.REWARD, reward)
    scope = Scope(parents, constants, declarations, {}, math=MATH_REQUIREMENT in requirements)
    axioms = _axioms(definition.axioms, scope)
    scope = replace(scope, derived=frozenset(axiom.name for axiom in axioms))
    names: set[str] = set()
    schemas: list[x.Schema] = []
    for group in definition.schemas:
        with source.recovering():
            schema = _schema(group, scope, names)
            if schema is not None:
                schemas.append(schema)
    return x.DomainSyntax(
        definition.name,
        parents,
        constants,
        declarations,
        tuple(schemas),
        axioms,
        requirements,
        definition.place,
    )


def _axioms(groups: Sequence[Group], scope: Scope) -> tuple[x.Axiom, ...]:
    """Parse axioms, which must be stratified: none depends on its own negation."""
    axioms: list[x.Axiom] = []
    for group in groups:
        with group.place.source.recovering():
            if len(group.items) != 3:
                raise DomainError(
                    "`:derived` takes a predicate with its parameters, and a condition",
                    group.place,
                    "write `(:derived (above ?x ?y - block) (or ...))`",
                )
            head = expect_group(group.items[1], "a predicate with its parameters")
            declaration = declared_as(head, scope, numeric=False)
            parameters = parse_parameters(head.items[1:], dict(scope.parents))
            if len(parameters) != len(declaration.parameters) or declaration.reserved:
                problem = f"`{head.place.text}` cannot be derived"
                advice = f"it is declared as {declaration.place.text}"
                raise DomainError(problem, head.place, advice, code="wrong-arguments")
            parameters = tuple(
                own if own.types != (x.OBJECT,) else replace(own, types=declared.types)
                for own, declared in zip(parameters, declaration.parameters, strict=True)
            )
            condition = parse_condition(group.items[2], scope.bind(parameters))
            axioms.append(x.Axiom(declaration.name, parameters, condition, group.place))
    for group in groups[:1]:
        with group.place.source.recovering():
            refuse_unstratified(axioms)
    return tuple(axioms)


def refuse_unstratified(axioms: Sequence[x.Axiom]) -> None:
    """Refuse a derived predicate that depends on its own negation: it has no single meaning."""
    reads: dict[str, set[tuple[str, bool]]] = {}
    for axiom in axioms:
        reads.setdefault(axiom.name, set()).update(_polarities(axiom.condition, True))
    for axiom in axioms:
        reached = {(name, not positive) for name, positive in reads[axiom.name]}
        todo = list(reached)
        while todo:
            name, negated = todo.pop()
            further = {(n, negated or not positive) for n, positive in reads.get(name, ())}
            todo += further - reached
            reached |= further
        if (axiom.name, True) in reached:
            raise DomainError(
                f"`{axiom.name}` depends on its own negation",
                axiom.place,
                "derive it from other predicates",
                code="type-conflict",
            )


def _polarities(condition: x.Condition, positive: bool) -> Iterator[tuple[str, bool]]:
    """Yield the predicates that a condition reads, and whether it wants them to be true."""
    match condition:
        case x.Atom(name):
            yield name, positive
        case x.Connective("not", (operand,)):
            yield from _polarities(operand, not positive)
        case x.Connective("imply", (premise, conclusion)):
            yield from _polarities(premise, not positive)
            yield from _polarities(conclusion, positive)
        case x.Connective(_, operands):
            for operand in operands:
                yield from _polarities(operand, positive)
        case x.Quantified(_, _, body):
            yield from _polarities(body, positive)


def _schema(group: Group, scope: Scope, names: set[str]) -> x.Schema | None:
    """Parse an action, a process or an event; None where errors in it were taken.

    Its name joins `names`, those of the schemas before it.
    """
    kind, source = SCHEMA_SECTIONS[group.head], group.place.source
    taken = source.errors_taken
    if len(group.items) < 2:
        raise DomainError(f"`{group.head}` has no name", group.place)
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
    if ":vars" in fields:  # of PDDL 1.2
        text = "`:vars` is read as more parameters; other tools may not do this"
        fields[":vars"].place.warn(text)
    bound: dict[str, x.SchemaParameter] = {}
    for key in (":parameters", ":vars"):
        listed: tuple[x.SchemaParameter, ...] = _said(
            fields.get(key),
            lambda group: parse_parameters(group.items, dict(scope.parents)),
            (),
            declares=True,
        )
        bound |= {parameter.name: parameter for parameter in listed}
    parameters = tuple(bound.values())
    inner = replace(scope, in_process=kind is x.Kind.PROCESS, in_action=kind is x.Kind.ACTION).bind(
        parameters
    )
    always: x.Condition = x.Connective("and", (), group.place)
    precondition = _said(fields.get(":precondition"), lambda c: parse_condition(c, inner), always)
    effects: tuple[x.Effect, ...] = _said(
        fields.get(":effect"), lambda effect: _effects(effect, inner), ()
    )
    if source.errors_taken > taken:
        return None
    return x.Schema(kind, name, parameters, precondition, effects, group.place)


def _effects(group: Group, scope: Scope) -> tuple[x.Effect, ...]:
    effects = parse_effects(group, scope)
    refuse_contradictions(effects)
    return effects


def _fields(group: Group, schema: str) -> dict[str, Group]:
    """Return what `:parameters`, `:precondition` and `:effect` of a schema say."""
    fields: dict[str, Group] = {}
    rest = group.items[2:]
    begins = [k for k, node in enumerate(rest) if getattr(node, "text", "").startswith(":")]
    for begin, end in itertools.pairwise(sorted({0, *begins, len(rest)})):
        key, *values = rest[begin:end]
        with key.place.recovering():
            if not isinstance(key, Word) or key.text not in SCHEMA_FIELDS:
                raise _no_field(key, schema)
            if key.text in fields:
                raise DomainError(
                    f"a second `{key.text}` in {schema}", key.place, code="declared-twice"
                )
            if not values:
                raise DomainError(f"`{key.text}` has no value", key.place, code="missing-value")
            fields[key.text] = expect_group(values[0], f"the value of `{key.text}`")
            if len(values) > 1:
                extra = values[1]
                field = isinstance(extra, Word) or extra.head in SCHEMA_FIELDS
                if field or key.text == ":parameters":
                    raise _no_field(extra, schema)
                forms = [*itertools.takewhile(lambda item: isinstance(item, Group), values)]
                raise several(f"`{key.text}` takes one form, found {len(forms)}", forms)
    return fields


def _no_field(node: Node, schema: str) -> DomainError:
    """Return what is wrong where `:parameters`, `:precondition` or `:effect` is expected."""
    instead = write = None
    if isinstance(node, Word):
        instead, write = INSTEAD.get(node.text), closest(node.text, SCHEMA_FIELDS)
    elif node.head in SCHEMA_FIELDS:
        write = written(node)[1:-1]
    return DomainError(
        f"`{node.place.text}` is not supported in {schema}",
        node.place,
        instead or "expected :parameters, :precondition and :effect",
        write=None if instead else write,
        code="unsupported" if instead else "unknown-section",
    )


PROBLEM_SECTIONS = (
    ":domain", ":requirements", ":objects", ":init", ":goal", ":goal-reward", ":metric"
)  # fmt: skip


def parse_problem(source: Source, domain: x.DomainSyntax) -> x.ProblemSyntax:
    """Parse the problem file that belongs to a domain, like `parse_domain`."""
    definition = _definition(source, "problem", PROBLEM_SECTIONS)
    sections = definition.sections
    _said(sections.get(":domain"), lambda group: _check_domain_name(group, domain), None)
    requirements = domain.requirements | _requirements(sections.get(":requirements"))
    own: dict[str, x.ObjectDeclaration] = _said(
        sections.get(":objects"), lambda group: _objects(group, domain), {}, declares=True
    )
    objects = {**domain.constants, **own}
    math = MATH_REQUIREMENT in requirements
    scope = Scope(
        domain.parents, objects, domain.declarations, {}, domain.derived, math=math,
        declares=":objects",
    )  # fmt: skip
    init = sections.get(":init")
    atoms, values = _initial(init, scope) if init is not None else ((), ())
    goal = _said(sections.get(":goal"), lambda group: _goal(group, scope), None)
    worth = _said(sections.get(":goal-reward"), _goal_reward, None)
    metric = _said(sections.get(":metric"), lambda group: _metric(group, scope), None)
    place = init.place if init is not None else None
    return x.ProblemSyntax(
        definition.name, objects, atoms, values, goal, worth, metric, definition.place, place
    )


def _objects(group: Group, domain: x.DomainSyntax) -> dict[str, x.ObjectDeclaration]:
    objects = parse_objects(group, domain.parents)
    for declared in objects.values():
        known = domain.constants.get(declared.name)
        if known is not None and known.type != declared.type:
            problem = f"`{declared.name}` is a constant of type `{known.type}` in the domain"
            raise DomainError(problem, declared.place, code="declared-twice")
    return objects


def _check_domain_name(group: Group, domain: x.DomainSyntax) -> None:
    if len(group.items) != 2 or not isinstance(group.items[1], Word):
        raise DomainError("expected `(:domain name)`", group.place)
    word = group.items[1]
    if word.text != domain.name:
        text = f"this problem names domain `{word.text}`, not `{domain.name}`"
        word.place.warn(text, "other-domain", write=domain.name)


def _initial(
    group: Group, scope: Scope
) -> tuple[tuple[x.Atom, ...], tuple[tuple[x.FunctionTerm, x.Number], ...]]:
    """Parse `:init` into what is true, and the values of functions."""
    source = group.place.source
    atoms: list[x.Atom] = []
    denied: dict[Hashable, Place] = {}
    values: dict[Hashable, tuple[x.FunctionTerm, x.Number]] = {}
    for node in group.items[1:]:
        with source.recovering():
            item = expect_group(node, "a fact")
            if item.head == "=":
                given = _value(item, scope)
                if given and (known := values.setdefault(x.meaning(given[0]), given)) is not given:
                    problem = f"a second value for `{given[0].place.text}`"
                    if known[1].value != given[1].value:
                        raise DomainError(problem, item.place, code="declared-twice")
                    item.place.warn(problem, "declared-twice", write="")
            elif item.head == "not":
                fact = parse_condition(item.items[1], scope) if len(item.items) == 2 else None
                if not isinstance(fact, x.Atom):
                    raise DomainError("`not` takes one predicate", item.place)
                denied[x.meaning(fact)] = item.place  # false anyway, unless it is stated too
            else:
                atoms.append(_fact(item, scope))
    for atom in atoms:
        if (place := denied.get(x.meaning(atom))) is not None:
            with source.recovering():
                problem = f"`{atom.place.text}` is also stated to be true"
                raise DomainError(problem, place, code="declared-twice")
    return tuple(atoms), tuple(values.values())


def _value(item: Group, scope: Scope) -> tuple[x.FunctionTerm, x.Number] | None:
    """Parse `(= (function) number)`; None where it says what holds anyway."""
    if len(item.items) != 3:
        raise DomainError("expected `(= (function) number)`", item.place)
    target = expect_group(as_function(item.items[1], scope), "a function")
    known = {*scope.declarations, *RESERVED_WORDS, *x.MATH_FUNCTIONS, x.REWARD, TOTAL_TIME}
    name = target.head
    if name and name[0].isalpha() and name not in known and not closest(name, known):
        text = f"the domain has no function `{name}`; its value is left out"
        item.place.warn(text, "unknown-name", write="")
        return None
    # What a metric may read, an initial value may name: `(reward)` too.
    function = parse_expression(target, replace(scope, in_metric=True))
    if isinstance(function, x.TotalTime) and parse_number(item.items[2]).value == 0.0:
        text = "`(total-time)` always starts at 0; leave this out"
        item.place.warn(text, "needless", write="")
        return None
    if not isinstance(function, x.FunctionTerm):
        raise DomainError("expected a function of the domain", function.place)
    value = parse_number(item.items[2])
    if function.name != x.REWARD:
        return function, value
    if value.value != 0.0:
        problem = "`(reward)` starts at 0 in every step"
        raise DomainError(problem, value.place, code="reserved-name")
    return None


def _fact(item: Group, scope: Scope) -> x.Atom:
    if item.head == "at" and len(item.items) == 3 and isinstance(item.items[2], Group):
        raise unsupported("timed initial literals are not supported", item.place, "timed")
    uncertain = item.head in ("oneof", "or", "unknown", "probabilistic")
    if uncertain and item.head not in scope.declarations:
        problem = f"`{item.head}` is not supported in `:init`"
        raise unsupported(problem, item.place.opening, "unknown")
    fact = parse_condition(item, scope)
    if not isinstance(fact, x.Atom):
        raise DomainError(
            "expected a predicate over objects or `(= (function) number)`",
            item.place,
            "list facts one after the other, without `and`" if item.head == "and" else "",
        )
    if fact.name in scope.derived:
        problem = f"`{fact.name}` is derived, so :init cannot state it"
        raise DomainError(problem, item.place, code="wrong-kind")
    if scope.declarations[fact.name].reserved:
        problem = f"`({fact.name})` is false at the start of every step"
        raise DomainError(problem, item.place, code="reserved-name")
    return fact


def _goal(group: Group, scope: Scope) -> x.Condition | None:
    if len(group.items) != 2:
        raise DomainError("expected `(:goal condition)`", group.place)
    taken = group.place.source.errors_taken
    goal = parse_condition(group.items[1], scope)
    return goal if group.place.source.errors_taken == taken else None


def _goal_reward(group: Group) -> x.Number:
    if len(group.items) != 2:
        raise DomainError("expected `(:goal-reward number)`", group.place)
    return parse_number(group.items[1])


def _metric(group: Group, scope: Scope) -> x.Metric:
    if len(group.items) != 3 or not isinstance(group.items[1], Word):
        raise DomainError("expected `(:metric maximize|minimize expression)`", group.place)
    sense = group.items[1]
    if sense.text not in ("maximize", "minimize"):
        raise DomainError(f"expected maximize or minimize, found `{sense.text}`", sense.place)
    expression = parse_expression(group.items[2], replace(scope, in_metric=True))
    return x.Metric(sense.text == "maximize", expression, group.place)
