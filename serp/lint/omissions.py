"""What a domain file that is right may still have forgotten."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from serp.lint.semantics import anywhere, semantic_warnings
from serp.model.ground import UNSAFE_TARGET, GroundModel, SetBoolean, writes
from serp.model.loading import Domain
from serp.pddl import syntax as x
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.source import DomainWarning

_ADL = (":typing", ":negative-preconditions", ":disjunctive-preconditions", ":equality",
        ":quantified-preconditions", ":conditional-effects")  # fmt: skip
_IMPLIED = {
    ":adl": _ADL,
    ":quantified-preconditions": (":existential-preconditions", ":universal-preconditions"),
    ":action-costs": (":numeric-fluents",),
    ":fluents": (":numeric-fluents",),
    ":numeric-fluents": (":fluents",),
    ":hybrid": (":time", ":numeric-fluents"),
    ":processes": (":time",),
    ":events": (":time",),
    ":continuous-effects": (":time",),
}
_SCHEMAS = (":action", ":process", ":event", ":constraint")


def warnings_of(domain: Domain) -> list[DomainWarning]:
    """Return what may have been forgotten or misspelt; none of it stops a training.

    Args:
        domain: A domain that was loaded, hence free of errors.
    """
    of_loading = domain.warnings
    wide = anywhere(domain)
    return [
        *of_loading,
        *_nothing_said(domain, wide),
        *_flags_read_in_actions(domain),
        *_schemas_without_use(domain, wide),
        *semantic_warnings(domain, wide),
        *_unused_names(domain),
        *_unused_variables(domain),
        *_unused_types(domain),
        *_missing_requirements(domain),
    ]


def _nothing_said(domain: Domain, wide: GroundModel) -> Iterator[DomainWarning]:
    model = domain.model
    name = domain.source.name
    if not model.actions:
        yield DomainWarning(f"{name}: no ground action, so there is nothing to plan with")
    if not _makes_unsafe(wide):
        yield DomainWarning(
            f"{name}: nothing is ever `(unsafe)`, so nothing will be refused for safety's sake"
        )
    if not model.rewarding:
        yield DomainWarning(
            f"{name}: nothing changes `(reward)`, so the planner has no reason to prefer anything"
        )


def _makes_unsafe(ground: GroundModel) -> bool:
    return any(
        isinstance(effect, SetBoolean) and effect.target == UNSAFE_TARGET and effect.value
        for schema in ground.schemas
        for effect in schema.effects
    )


def _flags_read_in_actions(domain: Domain) -> Iterator[DomainWarning]:
    """Find conditions of actions on `(unsafe)` or `(terminal)`, which start false in every step."""
    for schema in domain.syntax.schemas:
        if schema.kind is not x.Kind.ACTION:
            continue
        conditions = [schema.precondition] if schema.precondition is not None else []
        for atom in (*_atoms(conditions), *_atoms_of_effects(schema.effects)):
            if atom.name in (x.UNSAFE, x.TERMINAL):
                yield DomainWarning(
                    f"`({atom.name})` starts false in every step, so action `{schema.name}` "
                    "always finds it false; events are the ones that can read it",
                    atom.place,
                )


def _atoms_of_effects(effects: tuple[x.Effect, ...]) -> Iterator[x.Atom]:
    for effect in effects:
        match effect:
            case x.When(condition, inner):
                yield from _atoms([condition])
                yield from _atoms_of_effects(inner)
            case x.ForallEffect(_, inner):
                yield from _atoms_of_effects(inner)


def _atoms(conditions: Iterable[x.Condition]) -> Iterator[x.Atom]:
    for condition in conditions:
        match condition:
            case x.Atom():
                yield condition
            case x.Connective(_, operands):
                yield from _atoms(operands)
            case x.Quantified(_, _, body):
                yield from _atoms([body])


def _schemas_without_use(domain: Domain, wide: GroundModel) -> Iterator[DomainWarning]:
    instances: dict[str, list[bool]] = {schema.name: [] for schema in domain.syntax.schemas}
    for instance in wide.schemas:
        instances[instance.schema].append(bool(writes(instance)))
    objects = domain.problem_syntax.objects if domain.problem_syntax else domain.syntax.constants
    for schema in domain.syntax.schemas:
        what = f"{schema.kind.value} `{schema.name}`"
        if not instances[schema.name]:
            empty = _type_without_objects(domain.syntax, schema, objects.values())
            why = (
                f"there is no object of type `{empty}`"
                + ("" if domain.problem_syntax else " (nor a problem file that could name some)")
                if empty
                else "its precondition can never hold"
            )
            yield DomainWarning(f"{what} has no instance: {why}", schema.place)
        elif not any(instances[schema.name]) and not (
            # Waiting is an action where the world moves on by itself.
            schema.kind is x.Kind.ACTION and not schema.effects and wide.processes
        ):
            yield DomainWarning(f"{what} changes nothing", schema.place)


def _type_without_objects(
    syntax: x.DomainSyntax, schema: x.Schema, objects: Iterable[x.ObjectDeclaration]
) -> str | None:
    types = [declared.type for declared in objects]
    for parameter in schema.parameters:
        if not any(syntax.is_a(t, wanted) for t in types for wanted in parameter.types):
            return "/".join(parameter.types)
    return None


def _unused_names(domain: Domain) -> Iterator[DomainWarning]:
    """Find what is declared but neither changed nor read, by name."""
    sections = list(_sections(domain, (*_SCHEMAS, ":goal", ":metric")))
    read = {group.head for section in sections for group in _groups(section)}
    bare = {word.text for section in sections for word in _words(section)}
    for declaration in domain.syntax.declarations.values():
        name = declaration.name
        # A function without arguments may stand without parentheses.
        used = name in read or (declaration.numeric and not declaration.parameters and name in bare)
        if not used and name not in (x.REWARD, x.UNSAFE):
            what = "function" if declaration.numeric else "predicate"
            yield DomainWarning(
                f"{what} `{name}` is declared, but nothing changes or reads it",
                declaration.place,
            )


def _unused_variables(domain: Domain) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    for section in _sections(domain, _SCHEMAS):
        listed, rest = _split_parameters(section)
        what = " ".join(item.text for item in section.items[:2] if isinstance(item, Word))
        yield from _unread(listed, rest, f"`({what}`")
        for group in _groups(section):
            if group.head in ("forall", "exists") and len(group.items) == 3:
                yield from _unread(group.items[1], group.items[2:], f"`({group.head}`")


def _split_parameters(section: Group) -> tuple[Node | None, list[Node]]:
    """Return the list of parameters of a schema, and all the rest of it."""
    items = list(section.items)
    for index, item in enumerate(items[:-1]):
        if isinstance(item, Word) and item.text == ":parameters":
            return items[index + 1], items[:index] + items[index + 2 :]
    return None, items


def _unread(listed: Node | None, rest: Iterable[Node], what: str) -> Iterator[DomainWarning]:
    read = {word.text for node in rest for word in _words(node)}
    for word in _words(listed) if listed is not None else ():
        if word.text.startswith("?") and word.text not in read:
            yield DomainWarning(f"parameter `{word.text}` of {what} is not used", word.place)


def _unused_types(domain: Domain) -> Iterator[DomainWarning]:
    """Find types that no parameter and no object has, nor one of a type below them."""
    syntax = domain.syntax
    read = {
        word.text
        for source in (domain.source, domain.problem_source)
        if source is not None
        for section in read_group(source).items[2:]
        if isinstance(section, Group) and section.head != ":types"
        for word in _words(section)
    }
    used: set[str] = set()
    for name in read & syntax.parents.keys():
        while name in syntax.parents and name not in used:  # what it is a kind of is used as well
            used.add(name)
            name = syntax.parents[name]
    for section in _sections(domain, (":types",)):
        for word in _words(section):
            if word.text in syntax.parents and word.text not in used:
                used.add(word.text)
                yield DomainWarning(
                    f"type `{word.text}` is declared, but nothing is of it", word.place
                )


def _words(node: Node) -> Iterator[Word]:
    if isinstance(node, Word):
        yield node
    else:
        for item in node.items:
            yield from _words(item)


def _groups(group: Group) -> Iterator[Group]:
    yield group
    for item in group.items:
        if isinstance(item, Group):
            yield from _groups(item)


def _sections(domain: Domain, heads: tuple[str, ...]) -> Iterator[Group]:
    for source in (domain.source, domain.problem_source):
        if source is not None:
            for section in read_group(source).items[2:]:
                if isinstance(section, Group) and section.head in heads:
                    yield section


def _missing_requirements(domain: Domain) -> Iterator[DomainWarning]:
    section = next(_sections(domain, (":requirements",)), None)
    listed = {word.text for word in section.items if isinstance(word, Word)} if section else set()
    declared = set(listed)
    while more := {i for d in declared for i in _IMPLIED.get(d, ())} - declared:
        declared |= more
    missing = [need for need in _needs(domain.syntax) if need not in declared]
    if missing:
        place = section.place if section else domain.syntax.place
        why = " (processes and events need it)" if ":time" in missing else ""
        yield DomainWarning(
            f"used, but not among the :requirements: {' '.join(missing)}{why}", place
        )


def _needs(syntax: x.DomainSyntax) -> list[str]:
    """Return the requirements that a domain makes use of."""
    found: dict[str, None] = {}
    parameters = [
        *(p for s in syntax.schemas for p in s.parameters),
        *(p for d in syntax.declarations.values() for p in d.parameters),
    ]
    if syntax.parents or any(p.types != (x.OBJECT,) for p in parameters):
        found[":typing"] = None
    if any(d.numeric for d in syntax.declarations.values()):
        found[":numeric-fluents"] = None
    if any(s.kind is not x.Kind.ACTION for s in syntax.schemas):
        found[":time"] = None
    for schema in syntax.schemas:
        if schema.precondition is not None:
            found.update(dict.fromkeys(_of_condition(schema.precondition)))
        found.update(dict.fromkeys(_of_effects(schema.effects)))
    return list(found)


def _of_condition(condition: x.Condition) -> Iterator[str]:
    match condition:
        case x.SameObject():
            yield ":equality"
        case x.Connective(operator, operands):
            if operator == "not" and not isinstance(operands[0], x.SameObject):
                yield ":negative-preconditions"
            if operator in ("or", "imply"):
                yield ":disjunctive-preconditions"
            for operand in operands:
                yield from _of_condition(operand)
        case x.Quantified(operator, _, body):
            yield (
                ":existential-preconditions"
                if operator == "exists"
                else (":universal-preconditions")
            )
            yield from _of_condition(body)


def _of_effects(effects: tuple[x.Effect, ...]) -> Iterator[str]:
    for effect in effects:
        match effect:
            case x.When(condition, inner):
                yield ":conditional-effects"
                yield from _of_condition(condition)
                yield from _of_effects(inner)
            case x.ForallEffect(_, inner):
                yield ":conditional-effects"
                yield from _of_effects(inner)
