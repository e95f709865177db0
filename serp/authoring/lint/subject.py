"""What the rules of `serp check` look at: a loaded domain, its text and its instances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from serp.model.domain import Domain
from serp.model.ground import GroundModel, GroundSchema
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.source import DomainError, Place

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
        instances: dict[str, list[GroundSchema]] = {}
        for instance in self.anywhere.schemas:
            instances.setdefault(instance.schema, []).append(instance)
        return instances

    @cached_property
    def telling(self) -> dict[str, list[GroundSchema]]:
        """The `instances` that tell of their schema: no two parameters are the same object.

        With two rooms, `?from` and `?to` may differ; what comes of one room for both is a chance of
        the problem.
        """
        return {
            name: distinct
            for name, schemas in self.instances.items()
            if (distinct := [s for s in schemas if len({*s.arguments}) == len(s.arguments)])
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
