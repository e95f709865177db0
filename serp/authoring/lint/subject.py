"""What a rule of `serp check` is, and what it looks at: a loaded domain and its instances."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from serp.authoring.lint.contradiction import Pair, contradiction
from serp.model.domain import Domain
from serp.model.ground_model import GroundModel, GroundSchema
from serp.pddl import syntax as x
from serp.pddl.source import DomainError, DomainWarning

MOST_INSTANCES = 5_000
"""Most instances that the rules look at beyond those of a domain that is right."""


class WrittenSchema(NamedTuple):
    """An action, process or event: kind with name, the syntax, and all nodes of its effects."""

    what: str
    schema: x.Schema
    effects: list[object]

    @property
    def conditions(self) -> tuple[x.Condition, ...]:
        """The precondition, and the conditions of the effects."""
        inner = (node.condition for node in self.effects if isinstance(node, x.When))
        return (self.schema.precondition, *inner)


@dataclass(frozen=True)
class LintSubject:
    """A domain that was loaded, hence free of errors."""

    domain: Domain

    @cached_property
    def schemas(self) -> list[WrittenSchema]:
        """The actions, processes and events as written."""
        return [WrittenSchema(f"{of.kind.value} `{of.name}`", of, [*x.nodes_in(of.effects)])
                for of in self.domain.syntax.schemas]  # fmt: skip

    @cached_property
    def anywhere(self) -> GroundModel:
        """The domain for states that need not be reached from the problem's `:init`.

        Where that is too large, or needs numbers that are not given, it is what can be reached.
        """
        observed = self.domain.observed()
        if observed is not self.domain:
            most = min(MOST_INSTANCES, self.domain.max_ground_schemas)
            with contextlib.suppress(DomainError):
                return replace(observed, max_ground_schemas=most).model.ground
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
    def excluding(self) -> dict[str, list[Pair | None]]:
        """Name of a schema → of its `telling` instances, preconditions that exclude each other."""
        return {
            name: [contradiction(instance.preconditions, self.theta) for instance in schemas]
            for name, schemas in self.telling.items()
        }

    @property
    def waits_for_problem(self) -> bool:
        """Whether the domain is nothing without a problem that names its objects."""
        return (
            self.domain.problem_syntax is None
            and not self.domain.model.actions
            and any(schema.parameters for schema in self.domain.syntax.schemas)
        )


class Rule(NamedTuple):
    """What yields the warnings of a code.

    A `local` one is about single actions, processes and events, and right though others are
    unreadable; one that `needs_problem` waits for the problem that names the objects.
    """

    code: str
    warnings: Callable[[LintSubject], Iterator[DomainWarning]]
    local: bool
    needs_problem: bool

    def applied(self, subject: LintSubject, *, partial: bool) -> Iterator[DomainWarning]:
        """Yield the warnings about a domain; of one that is read in part, if the rule is local."""
        waits = self.needs_problem and subject.waits_for_problem
        if self.local if partial else not waits:
            yield from (replace(warning, code=self.code) for warning in self.warnings(subject))


def rule(
    code: str, *, local: bool = False, needs_problem: bool = False
) -> Callable[[Callable[[LintSubject], Iterator[DomainWarning]]], Rule]:
    """Make a rule of the function that yields its warnings, whose code is filled in."""
    return lambda warnings: Rule(code, warnings, local, needs_problem)
