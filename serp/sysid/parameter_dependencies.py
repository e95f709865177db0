"""Which parameters of a file change which fluents, and after which actions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from serp.model import ground as g
from serp.pddl.syntax import Kind

_ROLES = ("effect", "rate")
"""Roles of the parameters; static values of a problem are left out: conditions may read them."""


@dataclass(frozen=True)
class ParameterDependency:
    """The direct dependencies on one parameter.

    Attributes:
        parameter: The parameter.
        schema: Name of the action or process schema that contains it.
        symbol: Symbol of the function that its effect changes.
        fluents: Columns of the state that it changes directly.
        actions: Positions of the ground actions whose effects contain it; None for a process, which
            acts under every action.
    """

    parameter: g.Parameter
    schema: str
    symbol: str
    fluents: frozenset[int]
    actions: frozenset[int] | None


def parameter_dependencies(ground: g.GroundModel) -> tuple[ParameterDependency, ...]:
    """Return the dependencies on parameters of effects and rates, in the order of θ.

    Parameters of rewards, flags, conditions and events have none: the expert sets them.
    """
    fluents: dict[int, set[int]] = {}
    actions: dict[int, set[int]] = {}
    first: dict[int, tuple[g.GroundSchema, int]] = {}
    barred: set[int] = set()
    for position, schema in enumerate((*ground.actions, *ground.processes)):
        for target, index in _targets_and_parameters(schema):
            if target < 0:
                barred.add(index)
                continue
            first.setdefault(index, (schema, target))
            fluents.setdefault(index, set()).add(target)
            if schema.kind is not Kind.PROCESS:
                actions.setdefault(index, set()).add(position)
    return tuple(
        ParameterDependency(
            ground.parameters[index],
            schema.schema,
            ground.fluents[target].symbol,
            frozenset(fluents[index]),
            None if schema.kind is Kind.PROCESS else frozenset(actions[index]),
        )
        for index, (schema, target) in sorted(first.items(), key=lambda item: item[0])
        if index not in barred and ground.parameters[index].role in _ROLES
    )


def _targets_and_parameters(schema: g.GroundSchema) -> Iterator[tuple[int, int]]:
    """Yield (target, position in θ) for every parameter in the value of a numeric effect."""
    for effect in schema.effects:
        if isinstance(effect, g.SetNumber):
            for index in _parameters(effect.value):
                yield effect.target, index


def _parameters(value: g.Value) -> Iterator[int]:
    match value:
        case g.ParameterRef(index):
            yield index
        case g.Operation(_, left, right):
            yield from _parameters(left)
            yield from _parameters(right)
        case g.Negation(operand):
            yield from _parameters(operand)
