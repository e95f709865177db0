"""What the rules of `serp check` look at: a loaded domain, its text and its instances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from serp.model.ground import GroundModel, GroundSchema
from serp.model.loading import Domain
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.source import DomainError

SCHEMAS = (":action", ":process", ":event")
"""Sections that define an action, a process or an event."""


@dataclass(frozen=True)
class LintSubject:
    """A domain that was loaded, hence free of errors."""

    domain: Domain

    @cached_property
    def anywhere(self) -> GroundModel:
        """The domain for states that need not be reached from the problem's `:init`.

        Where that is too large, or needs numbers that are not given, it is what can be reached.
        """
        try:
            return self.domain.observed().model.ground
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
