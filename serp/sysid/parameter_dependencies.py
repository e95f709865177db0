"""Which literals of a file say how far which fluents change, and after which actions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from serp.model import ground as g
from serp.pddl.syntax import Kind

_ROLES = ("effect", "rate")  # and no static value of a problem, which conditions may read too


@dataclass(frozen=True)
class ParameterDependency:
    """What one literal has a direct say in.

    Attributes:
        parameter: The literal.
        schema: Name of the action or process schema in which it stands.
        symbol: Symbol of the function that its effect changes.
        fluents: Columns of the state that it changes directly.
        actions: Positions of the ground actions whose effects it stands in; None where it stands
            in a process, which goes on whatever the action.
    """

    parameter: g.Parameter
    schema: str
    symbol: str
    fluents: frozenset[int]
    actions: frozenset[int] | None


def parameter_dependencies(ground: g.GroundModel) -> tuple[ParameterDependency, ...]:
    """Return the literals of effects and rates that change fluents, in the order of θ.

    Literals of rewards, of flags, of conditions and of events are none of them: what an event
    does happens at a threshold, and what is good or unsafe is the expert's to say.
    """
    fluents: dict[int, set[int]] = {}
    actions: dict[int, set[int]] = {}
    first: dict[int, tuple[g.GroundSchema, int]] = {}
    barred: set[int] = set()
    for position, schema in enumerate(ground.actions):
        for target, literal in _written(schema):
            if target < 0:
                barred.add(literal)
                continue
            first.setdefault(literal, (schema, target))
            fluents.setdefault(literal, set()).add(target)
            actions.setdefault(literal, set()).add(position)
    for schema in ground.processes:
        for target, literal in _written(schema):
            if target < 0:
                barred.add(literal)
                continue
            first.setdefault(literal, (schema, target))
            fluents.setdefault(literal, set()).add(target)
    found = []
    for literal in sorted(first.keys() - barred):
        if ground.parameters[literal].role not in _ROLES:
            continue
        schema, target = first[literal]
        found.append(
            ParameterDependency(
                ground.parameters[literal],
                schema.schema,
                ground.fluents[target].symbol,
                frozenset(fluents[literal]),
                None if schema.kind is Kind.PROCESS else frozenset(actions[literal]),
            )
        )
    return tuple(found)


def _written(schema: g.GroundSchema) -> Iterator[tuple[int, int]]:
    """Yield (target, literal) for every literal in the value of a numeric effect."""
    for effect in schema.effects:
        if isinstance(effect, g.SetNumber):
            for literal in _literals(effect.value):
                yield effect.target, literal


def _literals(value: g.Value) -> Iterator[int]:
    match value:
        case g.ParameterRef(parameter):
            yield parameter
        case g.Operation(_, left, right):
            yield from _literals(left)
            yield from _literals(right)
        case g.Negation(operand):
            yield from _literals(operand)
        case _:
            return
