"""A ground model with effects added that its file does not mention."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import Vector
from serp.pddl.syntax import Change, Kind
from serp.sysid.lifted_features import WORLD, Lifted, Lifting, features

_ALWAYS = g.Constant(True)


@dataclass(frozen=True, order=True)
class AddedEffect:
    """One term that is added: the change of a fluent by a coefficient times a product.

    Attributes:
        schema: The action schema, or `WORLD` for a process.
        target: The fluent that changes.
        factors: Fluents whose product the coefficient multiplies; none for a constant.
    """

    schema: str
    target: Lifted
    factors: tuple[Lifted, ...]


def with_additions(lifting: Lifting, additions: Sequence[AddedEffect]) -> g.GroundModel:
    """Return the ground model with further effects, one new literal each, 0 as written.

    The new literals follow those of the file, in the order of the additions. An effect is added to
    every instance of its schema; in the world's, a process for every fluent of the symbol.
    """
    ground = lifting.ground
    parameters = list(ground.parameters)
    actions = list(ground.actions)
    processes = list(ground.processes)
    for addition in additions:
        world = addition.schema == WORLD
        lens = lifting.world(addition.target.symbol) if world else lifting.schema(addition.schema)
        index = len(parameters)
        place = ground.actions[0 if world else next(iter(lens.bindings))].place
        role = "rate" if world else "effect"
        parameters.append(g.Parameter(index, 0.0, role, place))
        for key, binding in lens.bindings.items():
            value: g.Value = g.ParameterRef(index)
            for factor in addition.factors:
                value = g.Operation("*", value, g.Read(lifting.column(factor, binding)))
            target = lifting.column(addition.target, binding)
            changed = None if world else _into_assignment(actions[key], target, value)
            if changed is not None:
                actions[key] = changed
                continue
            effect = g.SetNumber(target, Change.INCREASE, value, _ALWAYS, place)
            if world:
                name = f"added {index} {ground.fluents[target].name}"
                processes.append(
                    g.GroundSchema(Kind.PROCESS, name, WORLD, (), (), (effect,), place)
                )
            else:
                effects = (*actions[key].effects, effect)
                actions[key] = dataclasses.replace(actions[key], effects=effects)
    return dataclasses.replace(
        ground, parameters=tuple(parameters), actions=tuple(actions), processes=tuple(processes)
    )


def columns_of(
    lifting: Lifting,
    addition: AddedEffect,
    states: Vector,
    after: Vector,
    actions: NDArray[np.int64],
) -> dict[int, Vector]:
    """Return what coefficient 1 of an addition would change, without Δt: fluent → `[N]`.

    Args:
        lifting: The names of the file.
        addition: The term.
        states: `[N, F]` before the action.
        after: `[N, F]` once the action's effects are applied, which processes read.
        actions: `[N]`.
    """
    found: dict[int, Vector] = {}
    if addition.schema == WORLD:
        lens = lifting.world(addition.target.symbol)
        for key in lens.bindings:
            keys = np.full(len(states), key, dtype=np.int64)
            found[key] = features(lifting, lens, addition.factors, after, keys)
        return found
    lens = lifting.schema(addition.schema)
    values = features(lifting, lens, addition.factors, states, actions)
    for key, binding in lens.bindings.items():
        target = lifting.column(addition.target, binding)
        column = found.setdefault(target, np.zeros(len(states)))
        column[actions == key] = values[actions == key]
    return found


def _into_assignment(action: g.GroundSchema, target: int, value: g.Value) -> g.GroundSchema | None:
    """Return the action with the value added to what it assigns; None where it assigns nothing."""
    effects = list(action.effects)
    for k, effect in enumerate(effects):
        if (
            isinstance(effect, g.SetNumber)
            and effect.target == target
            and effect.change is Change.ASSIGN
        ):
            effects[k] = dataclasses.replace(effect, value=g.Operation("+", effect.value, value))
            return dataclasses.replace(action, effects=tuple(effects))
    return None
