"""Rules: what a domain file that is right may still have forgotten."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from serp.lint.subject import SCHEMAS, LintSubject, values_of
from serp.model.ground import UNSAFE_TARGET, SetBoolean, writes
from serp.pddl import syntax as x
from serp.pddl.declarations import typed_list
from serp.pddl.sexpr import Group, Node
from serp.pddl.source import DomainWarning


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


RULES = {
    "untyped": _untyped,
    "no-action": _no_action,
    "nothing-unsafe": _nothing_unsafe,
    "no-reward": _no_reward,
    "flag-read-in-action": _flags_read_in_actions,
    "schema-without-use": _schemas_without_use,
}
