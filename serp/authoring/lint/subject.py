"""What the rules of `serp check` look at: a loaded domain, its text and its instances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

from serp.model.domain import Domain
from serp.model.ground import Compare, GroundModel, GroundSchema, Holds, Not, fluents_of
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.source import DomainError, Place


class FindingCode(NamedTuple):
    """What a code stands for.

    Attributes:
        meaning: One sentence.
        error: Whether it is always an error, which no comment silences.
    """

    meaning: str
    error: bool = False


_ERRORS = {
    "bad-name": "A name has characters that names do not have.",
    "bad-number": "A word stands where a number belongs.",
    "contradictory-effects": "Two effects would have to happen at once and cannot.",
    "foreign-syntax": "A form of another language, or another order of words.",
    "malformed": "A form has too many or too few parts, or parts of another kind.",
    "math-functions": "A function of numbers that the file does not ask for, or that is unknown.",
    "missing-and": "Several forms stand where one belongs.",
    "missing-domain": "The file of the domain that a problem belongs to is not found.",
    "no-result": "A number that is never defined, such as a division by zero.",
    "process-effect": "Only processes have rates times `#t`, and they have nothing else.",
    "reserved-name": "A reserved name is declared as something else.",
    "reserved-use": "`reward`, `unsafe` or `terminal` is used as it cannot be.",
    "stray-text": "Characters that are not part of PDDL.",
    "too-large": "Too many instances, fluents or operations.",
    "type-conflict": "Types that are their own ancestors, or several where there can be one.",
    "unbalanced-parentheses": "A parenthesis is missing, or one too many.",
    "unknown-field": "An action, process or event has no such field.",
    "unknown-name": "A predicate or function that is not declared.",
    "unknown-object": "An object that is not declared.",
    "unknown-section": "A file has no such section.",
    "unknown-type": "A type that is not declared.",
    "unknown-variable": "A variable that no `:parameters`, `forall` or `exists` binds.",
    "unreadable-file": "A file cannot be read.",
    "unsupported": "PDDL that SErP does not support, and what to write instead.",
    "wrong-arity": "Too many or too few arguments.",
    "wrong-kind": "A predicate where a function belongs, a condition where an effect does.",
    "wrong-type": "An argument of another type than the declared one.",
}
_WARNINGS = {
    "always-true": "A condition holds in every state.",
    "always-unsafe": "An action is unsafe wherever it can be applied, or an event always fires.",
    "assigned-twice": "One list of effects sets a function to two numbers.",
    "contradictory-condition": "A condition that can never hold.",
    "dead-alternative": "An alternative of an `or` that can never hold.",
    "dead-effect": "An effect under a `when` that can never hold.",
    "declared-twice": "A second declaration; an error where it differs from the first.",
    "double-negative": "A decrease by a negative number, or an increase by one.",
    "flag-read-in-action": "An action reads a flag, which it always finds false.",
    "flag-never-set": "An event waits for a flag that is set only where it cannot fire.",
    "frozen-fluent": "An event waits for a number that nothing changes.",
    "hidden-function": "A declared function has the name of one of `:math-functions`.",
    "missing-requirement": "The file uses what it does not list under `:requirements`.",
    "missing-value": "A number, field or initial value is missing; an error where it is needed.",
    "needless": "Something that can be left out.",
    "never-read": "A function or predicate that effects change, and nothing reads.",
    "no-action": "There is nothing to plan with.",
    "no-change": "An effect changes nothing.",
    "no-reward": "Nothing changes the reward.",
    "not-portable": "Other PDDL tools do not read this.",
    "not-reached": "What cannot happen from the problem's `:init` on.",
    "nothing-unsafe": "No action will ever be refused.",
    "one-way": "A number only ever moves away from a limit.",
    "other-domain": "The problem names another domain.",
    "out-of-range": "A number far outside what the task observes.",
    "redundant-condition": "A condition that another one beside it makes needless.",
    "repeated-effect": "One list of effects says the same twice.",
    "same-schema": "Two actions, processes or events say the same.",
    "schema-without-use": "An action, process or event has no instance, or changes nothing.",
    "set-and-unset": "One list of effects makes a predicate both true and false.",
    "task-mismatch": "The task that the file belongs to does not fit it.",
    "unbounded-goal": "Nothing bounds what the metric gains in a step.",
    "unknown-requirement": "A requirement that SErP does not know.",
    "untyped": "A parameter or an object without a type, in a file that has types.",
    "unused-extension": "`:math-functions` is listed, and nothing needs it.",
    "unused-name": "A predicate or function that nothing changes or reads.",
    "unused-parameter": "A parameter that nothing reads.",
    "unused-type": "A type that nothing has.",
    "useless-silence": "A comment that silences nothing.",
}
NOTES = frozenset(("not-portable", "nothing-unsafe"))
"""Warnings that are true of many a file which is as it should be; they are shown as notes."""
CODES: Mapping[str, FindingCode] = MappingProxyType(
    {
        **{code: FindingCode(meaning, error=True) for code, meaning in _ERRORS.items()},
        **{code: FindingCode(meaning) for code, meaning in _WARNINGS.items()},
    }
)
"""Code → what it stands for."""


SCHEMAS = (":action", ":process", ":event")
"""Sections that define an action, a process or an event."""
MOST_INSTANCES = 5_000
"""Most instances that the rules look at beyond those of a domain that is right."""


@dataclass(frozen=True)
class LintSubject:
    """A domain that was loaded, hence free of errors."""

    domain: Domain

    @cached_property
    def anywhere(self) -> GroundModel:
        """The domain for states that need not be reached from the problem's `:init`.

        Where that is too large, or needs numbers that are not given, it is what can be reached.
        """
        most = min(MOST_INSTANCES, self.domain.max_ground_schemas)
        try:
            return replace(self.domain.observed(), max_ground_schemas=most).model.ground
        except DomainError:
            return self.domain.model.ground

    @cached_property
    def theta(self) -> list[float]:
        """The values of the parameters of `anywhere`."""
        return [parameter.value for parameter in self.anywhere.parameters]

    @cached_property
    def instances(self) -> dict[str, list[GroundSchema]]:
        """Name of a schema → its instances, where it has any."""
        found: dict[str, list[GroundSchema]] = {}
        for instance in self.anywhere.schemas:
            found.setdefault(instance.schema, []).append(instance)
        return found

    @cached_property
    def telling(self) -> dict[str, list[GroundSchema]]:
        """The `instances` that tell of their schema: no two parameters are the same object.

        With two rooms, `?from` and `?to` may differ; what comes of one room for both is a chance of
        the problem.
        """
        return {
            name: kept
            for name, schemas in self.instances.items()
            if (kept := [s for s in schemas if len({*s.arguments}) == len(s.arguments)])
        }

    @cached_property
    def quantified(self) -> list[Place]:
        """The places of all `forall` and `exists` in conditions."""
        return [
            condition.place
            for schema in self.domain.syntax.schemas
            for condition in x.conditions_of(schema)
            if isinstance(condition, x.Quantified)
        ]

    def alike(self, first: Compare | Holds | Not, second: Compare | Holds | Not) -> bool:
        """Whether two conditions can be compared, whatever the objects of the problem are.

        They read the same, and stand in the same quantifiers: what `forall` says of one object is
        what `exists` says of it only where there is no other.
        """
        around = [
            [quantifier for quantifier in self.quantified if test.place.within(quantifier)]
            for test in (first, second)
        ]
        return around[0] == around[1] and not {*fluents_of(first)}.isdisjoint(fluents_of(second))

    @property
    def waits_for_problem(self) -> bool:
        """Whether the domain is nothing without a problem that names its objects."""
        return (
            self.domain.problem_syntax is None
            and not self.domain.model.actions
            and any(schema.parameters for schema in self.domain.syntax.schemas)
        )

    def sections(self, *heads: str) -> Iterator[Group]:
        """Yield the sections of both files that begin with one of some words."""
        for source in (self.domain.source, self.domain.problem_source):
            if source is not None:
                for section in read_group(source).items[2:]:
                    if isinstance(section, Group) and section.head in heads:
                        yield section


def values_of(section: Group) -> dict[str, Node]:
    """Return `:parameters`, `:precondition` and `:effect` of a schema, as far as they are there."""
    return {
        key.text: value
        for key, value in zip(section.items[2::2], section.items[3::2], strict=False)
        if isinstance(key, Word)
    }


def words_in(node: Node) -> Iterator[Word]:
    """Yield every word of a form."""
    if isinstance(node, Word):
        yield node
    else:
        for item in node.items:
            yield from words_in(item)


def groups_in(group: Group) -> Iterator[Group]:
    """Yield a list and every list in it."""
    yield group
    for item in group.items:
        if isinstance(item, Group):
            yield from groups_in(item)
