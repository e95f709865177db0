"""Rules: what a domain declares and does not use, or uses and does not declare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from serp.authoring.lint.subject import SCHEMAS, LintSubject, groups_in, values_of, words_in
from serp.model.ground import UNSAFE_TARGET, SetBoolean, writes
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word
from serp.pddl.source import DomainWarning


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


def _unused_parameters(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    understood = {schema.name for schema in subject.domain.syntax.schemas}
    for section in subject.sections(*SCHEMAS):
        if len(section.items) < 2 or section.items[1].place.text.lower() not in understood:
            continue
        what = " ".join(item.text for item in section.items[:2] if isinstance(item, Word))
        parameters = values_of(section).get(":parameters")
        yield from _unread(parameters, section, f"`({what}`")
        for group in groups_in(section):
            if group.head in ("forall", "exists") and len(group.items) == 3:
                yield from _unread(group.items[1], group, f"`({group.head}`")


def _unread(parameters: Node | None, form: Group, what: str) -> Iterator[DomainWarning]:
    """Find variables of a list that occur in a form only once."""
    if parameters is not None:
        occurrences = Counter(word.text for word in words_in(form))
        for word in words_in(parameters):
            if word.text.startswith("?") and occurrences[word.text] == 1:
                yield DomainWarning(f"parameter `{word.text}` of {what} is not used", word.place)


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


RULES = {
    "no-action": _no_action,
    "nothing-unsafe": _nothing_unsafe,
    "no-reward": _no_reward,
    "flag-read-in-action": _flags_read_in_actions,
    "schema-without-use": _schemas_without_use,
    "unused-name": _unused_names,
    "unused-parameter": _unused_parameters,
}
