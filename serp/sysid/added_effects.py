"""A ground model with added effects that its file does not contain."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import Vector
from serp.pddl.syntax import Change, Kind
from serp.sysid.lifted_features import WORLD, LiftedFluent, LiftedModel

_ALWAYS = g.Constant(True)


@dataclass(frozen=True, order=True)
class AddedEffect:
    """One added term: the change of a fluent by a coefficient times the product of the factors.

    `schema` is an action schema, or `WORLD` for a process; without factors, it is a constant.
    """

    schema: str
    target: LiftedFluent
    factors: tuple[LiftedFluent, ...]

    @property
    def symbols(self) -> tuple[str, tuple[str, ...]]:
        """The symbols of target and factors: equal for the same term of different schemas."""
        return self.target.symbol, tuple(f.symbol for f in self.factors)


def with_effects(lifted: LiftedModel, added: Sequence[AddedEffect]) -> g.GroundModel:
    """Return the ground model with further effects, one new parameter each, whose value is 0.

    The new parameters follow those of the file, in the order of the effects. An effect is added to
    every instance of its schema; an effect of the world becomes a process for every fluent of its
    symbol.
    """
    ground = lifted.ground
    parameters = list(ground.parameters)
    actions = list(ground.actions)
    processes = list(ground.processes)
    for term in added:
        world = term.schema == WORLD
        scope = lifted.world(term.target.symbol) if world else lifted.schema(term.schema)
        index = len(parameters)
        place = ground.actions[0 if world else next(iter(scope.bindings))].place
        parameters.append(g.Parameter(index, 0.0, "rate" if world else "effect", place))
        for key, binding in scope.bindings.items():
            value: g.Value = g.ParameterRef(index)
            for factor in term.factors:
                value = g.Operation("*", value, g.Read(lifted.column(factor, binding)))
            target = lifted.column(term.target, binding)
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


def effect_columns(
    lifted: LiftedModel,
    effect: AddedEffect,
    states: Vector,
    after: Vector,
    actions: NDArray[np.int64],
) -> dict[int, Vector]:
    """Return the changes by an added effect with coefficient 1, without Δt: fluent → `[N]`.

    `states` `[N, F]` are those before the `actions` `[N]`; `after` `[N, F]` those after the
    actions' effects, which processes read.
    """
    found: dict[int, Vector] = {}
    if effect.schema == WORLD:
        scope = lifted.world(effect.target.symbol)
        for key in scope.bindings:
            keys = np.full(len(states), key, dtype=np.int64)
            found[key] = lifted.products(scope, effect.factors, after, keys)
        return found
    scope = lifted.schema(effect.schema)
    values = lifted.products(scope, effect.factors, states, actions)
    for key, binding in scope.bindings.items():
        target = lifted.column(effect.target, binding)
        column = found.setdefault(target, np.zeros(len(states)))
        column[actions == key] = values[actions == key]
    return found


def _into_assignment(action: g.GroundSchema, target: int, value: g.Value) -> g.GroundSchema | None:
    """Return the action with a value added to its assignment; None where it has none."""
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
