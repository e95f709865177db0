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

    `schema` contains it, and its effect changes the `fluents`, columns of the function `symbol`.
    `actions` are the positions of the ground actions whose effects contain it; None for a process,
    which acts under every action.
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
        values = [(e.target, e.value) for e in schema.effects if isinstance(e, g.SetNumber)]
        for target, index in ((target, k) for target, value in values for k in _parameters(value)):
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


def _parameters(value: g.Value) -> Iterator[int]:
    """Yield the positions in θ of the parameters in a value."""
    match value:
        case g.ParameterRef(index):
            yield index
        case g.Operation(_, left, right):
            yield from _parameters(left)
            yield from _parameters(right)
        case g.Unary(_, operand):
            yield from _parameters(operand)
