"""Rules: what a domain file that is right may still have forgotten."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from serp.authoring.lint.subject import SCHEMAS, LintSubject, groups_in, values_of, words_in
from serp.model.ground import UNSAFE_TARGET, SetBoolean, writes
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.scope import typed_list
from serp.pddl.source import DomainWarning, Edit, Fix


def _unused_names(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what is declared but neither changed nor read, by name."""
    sections = list(subject.sections(*SCHEMAS, ":goal", ":metric"))
    read = {group.head for section in sections for group in groups_in(section)}
    bare = {word.text for section in sections for word in words_in(section)}
    for declaration in subject.domain.syntax.declarations.values():
        name = declaration.name
        # A function without arguments may stand without parentheses.
        used = name in read or (declaration.numeric and not declaration.parameters and name in bare)
        if not used and name not in (x.REWARD, x.UNSAFE):
            what = "function" if declaration.numeric else "predicate"
            yield DomainWarning(
                f"{what} `{name}` is declared, but nothing changes or reads it",
                declaration.place,
            )


def _unused_variables(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    understood = {schema.name for schema in subject.domain.syntax.schemas}
    for section in subject.sections(*SCHEMAS):
        if len(section.items) < 2 or section.items[1].place.text.lower() not in understood:
            continue
        listed, rest = _split_parameters(section)
        what = " ".join(item.text for item in section.items[:2] if isinstance(item, Word))
        yield from _unread(listed, rest, f"`({what}`")
        for group in groups_in(section):
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
    read = {word.text for node in rest for word in words_in(node)}
    for word in words_in(listed) if listed is not None else ():
        if word.text.startswith("?") and word.text not in read:
            yield DomainWarning(f"parameter `{word.text}` of {what} is not used", word.place)


def _unused_types(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find types that no parameter and no object has, nor one of a type below them."""
    domain = subject.domain
    syntax = domain.syntax
    read = {
        word.text
        for source in (domain.source, domain.problem_source)
        if source is not None
        for section in read_group(source).items[2:]
        if isinstance(section, Group) and section.head != ":types"
        for word in words_in(section)
    }
    used: set[str] = set()
    for name in read & syntax.parents.keys():
        while name in syntax.parents and name not in used:  # what it is a kind of is used as well
            used.add(name)
            name = syntax.parents[name]
    for section in subject.sections(":types"):
        for word in words_in(section):
            if word.text in syntax.parents and word.text not in used:
                used.add(word.text)
                yield DomainWarning(
                    f"type `{word.text}` is declared, but no object or parameter has it", word.place
                )


RULES = {
    "unused-name": _unused_names,
    "unused-parameter": _unused_variables,
    "unused-type": _unused_types,
}


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


def _missing_requirements(subject: LintSubject) -> Iterator[DomainWarning]:
    section = next(subject.sections(":requirements"), None)
    listed = {word.text for word in section.items if isinstance(word, Word)} if section else set()
    declared = set(listed)
    while more := {i for d in declared for i in _IMPLIED.get(d, ())} - declared:
        declared |= more
    missing = [need for need in _needs(subject.domain.syntax) if need not in declared]
    if missing:
        place = section.place if section else subject.domain.syntax.place
        why = " (processes and events need `:time`)" if ":time" in missing else ""
        fix = None
        if section is not None:
            fix = Fix((Edit(place.end - 1, place.end - 1, f" {' '.join(missing)}"),))
        text = f"used, but not among the :requirements: {' '.join(missing)}{why}"
        yield DomainWarning(text, place.opening, fix=fix)


def _unused_extension(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find the requirement that makes a file unreadable for other tools, and that it can go."""
    declarations = subject.domain.syntax.declarations
    sections = subject.sections(*SCHEMAS, ":goal", ":metric")
    numeric = {name for name, declared in declarations.items() if declared.numeric}
    used = {group.head for section in sections for group in groups_in(section)}
    if used & (x.MATH_FUNCTIONS.keys() - numeric):
        return
    for section in subject.sections(":requirements"):
        for word in words_in(section):
            if word.text == x.MATH_REQUIREMENT:
                yield DomainWarning(
                    f"`{word.text}` is listed and nothing needs it; without it, other tools can "
                    "read the file",
                    word.place,
                    fix=Fix((_without(word),)),
                )


def _without(word: Word) -> Edit:
    """Return the edit that leaves a word out, and the blank before it."""
    text, start = word.place.source.text, word.place.start
    return Edit(len(text[:start].rstrip(" ")), word.place.end, "")


def _needs(syntax: x.DomainSyntax) -> dict[str, None]:
    """Return the requirements that a domain makes use of, in order."""
    parameters = [p for s in syntax.schemas for p in s.parameters]
    parameters += [p for d in syntax.declarations.values() for p in d.parameters]
    general = {
        ":typing": syntax.parents or any(p.types != (x.OBJECT,) for p in parameters),
        ":numeric-fluents": any(d.numeric for d in syntax.declarations.values()),
        ":time": any(s.kind is not x.Kind.ACTION for s in syntax.schemas),
    }
    found = {need: None for need, used in general.items() if used}
    for schema in syntax.schemas:
        for condition in x.conditions_of(schema):
            found.update(dict.fromkeys(_of_condition(condition)))
        if any(isinstance(e, x.When | x.ForallEffect) for e in schema.effects):
            found[":conditional-effects"] = None
    return found


def _of_condition(condition: x.Condition) -> Iterator[str]:
    match condition:
        case x.SameObject():
            yield ":equality"
        case x.Connective("not", (operand,)) if not isinstance(operand, x.SameObject):
            yield ":negative-preconditions"
        case x.Connective("or" | "imply"):
            yield ":disjunctive-preconditions"
        case x.Quantified("exists"):
            yield ":existential-preconditions"
        case x.Quantified():
            yield ":universal-preconditions"


RULES_OF_REQUIREMENTS = {
    "missing-requirement": _missing_requirements,
    "unused-extension": _unused_extension,
}


def _no_action(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.actions:
        text, advice = "no ground action, so there is nothing to plan with", ""
        if subject.waits_for_problem:
            advice = (
                "give the problem file that names the objects: NAME-problem.pddl beside "
                "NAME.pddl, or `serp check domain.pddl problem.pddl`"
            )
        yield DomainWarning(text, subject.domain.syntax.place.opening, advice=advice)


def _nothing_unsafe(subject: LintSubject) -> Iterator[DomainWarning]:
    if not any(
        isinstance(effect, SetBoolean) and effect.target == UNSAFE_TARGET and effect.value
        for schema in subject.anywhere.schemas
        for effect in schema.effects
    ):
        yield DomainWarning(
            "nothing is ever `(unsafe)`, so no action will be refused",
            subject.domain.syntax.place.opening,
        )


def _no_reward(subject: LintSubject) -> Iterator[DomainWarning]:
    if not subject.domain.model.rewarding:
        yield DomainWarning(
            "nothing changes `(reward)`, so the planner has no reason to prefer an action",
            subject.domain.syntax.place.opening,
        )


def _flags_read_in_actions(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find conditions of actions on `(unsafe)` or `(terminal)`, which start false in every step."""
    for schema in subject.domain.syntax.schemas:
        if schema.kind is not x.Kind.ACTION:
            continue
        for atom in x.conditions_of(schema):
            if isinstance(atom, x.Atom) and atom.name in (x.UNSAFE, x.TERMINAL):
                yield DomainWarning(
                    f"`({atom.name})` starts false in every step, so action `{schema.name}` "
                    "always finds it false; events are the ones that can read it",
                    atom.place,
                )


def _schemas_without_use(subject: LintSubject) -> Iterator[DomainWarning]:
    domain = subject.domain
    objects = domain.problem_syntax.objects if domain.problem_syntax else domain.syntax.constants
    for schema in domain.syntax.schemas:
        what = f"{schema.kind.value} `{schema.name}`"
        instances = subject.instances.get(schema.name)
        if instances is None:
            empty = _type_without_objects(domain.syntax, schema, objects.values())
            why = (
                f"there is no object of type `{empty}`"
                + ("" if domain.problem_syntax else " (nor a problem file that could name some)")
                if empty
                else "its precondition can never hold"
                + (" in this problem" if domain.problem_syntax else "")
            )
            yield DomainWarning(f"{what} has no instance: {why}", schema.place.opening)
        elif not any(map(writes, instances)) and not (
            # Waiting is an action where the world moves on by itself.
            schema.kind is x.Kind.ACTION and not schema.effects and subject.anywhere.processes
        ):
            yield DomainWarning(f"{what} changes nothing", schema.place.opening)


def _type_without_objects(
    syntax: x.DomainSyntax, schema: x.Schema, objects: Iterable[x.ObjectDeclaration]
) -> str | None:
    types = [declared.type for declared in objects]
    for parameter in schema.parameters:
        if not any(syntax.is_a(t, wanted) for t in types for wanted in parameter.types):
            return "/".join(parameter.types)
    return None


def _untyped(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters and objects without a type in a file that has types."""
    if not subject.domain.syntax.parents:
        return
    for section in subject.sections(":constants", ":objects"):
        for word, types in typed_list(section.items[1:], "an object", variables=False):
            if not types:
                yield DomainWarning(f"object `{word.text}` has no type", word.place)
    for section in subject.sections(":predicates", ":functions", *SCHEMAS):
        lists: Iterable[Sequence[Node]] = (
            [item.items[1:] for item in section.items[1:] if isinstance(item, Group)]
            if section.head not in SCHEMAS
            else [node.items for node in (values_of(section).get(":parameters"),)
                  if isinstance(node, Group)]
        )  # fmt: skip
        for nodes in lists:
            for word, types in typed_list(nodes, "a parameter", variables=True):
                if not types:
                    yield DomainWarning(
                        f"parameter `{word.text}` has no type, so it can be any object",
                        word.place,
                        advice=f"write `{word.text} - object` if that is meant",
                    )


RULES_OF_OMISSIONS = {
    "untyped": _untyped,
    "no-action": _no_action,
    "nothing-unsafe": _nothing_unsafe,
    "no-reward": _no_reward,
    "flag-read-in-action": _flags_read_in_actions,
    "schema-without-use": _schemas_without_use,
}
