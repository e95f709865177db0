"""Candidates for effects that a file lacks, with the changes that each of them would cause.

Candidates are a constant, every numeric fluent in scope, and products of two of the fluents that
correlate most with the residuals; for the world, and for each action schema.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import Vector
from serp.pddl.syntax import Change, ChangeFunction, Kind
from serp.sysid.added_effects import AddedEffect
from serp.sysid.lifted_features import WORLD, LiftedFluent, LiftedModel, LiftedScope
from serp.sysid.parameter_fit import Rows
from serp.sysid.regression_data import RegressionData

_MAX_FACTORS = 12  # number of fluents whose products are candidates

MIN_ROWS = 12
"""Fewest transitions in which an estimated effect applies."""


def candidate_effects(
    lifted: LiftedModel,
    data: RegressionData,
    after: Vector,
    rows: Rows,
    symbol: str,
    dt: float,
    known: Sequence[AddedEffect],
) -> tuple[list[AddedEffect], Vector]:
    """Return candidates that are not `known`, with the changes by coefficient 1: `[n, M]`.

    `rows` are the residuals of the function `symbol`; `after` `[N, F]` are the states after the
    actions' effects, which processes read.
    """
    schemas = sorted({lifted.ground.actions[a].schema for a in np.unique(rows.groups).tolist()})
    effects: list[AddedEffect] = []
    columns: list[Vector] = []

    def offer(
        scope: LiftedScope, target: LiftedFluent, states: Vector, keys: NDArray[np.int64]
    ) -> None:
        unit = dt if scope.schema == WORLD else 1.0
        linear: list[tuple[float, LiftedFluent]] = []
        singles: dict[LiftedFluent, Vector] = {}
        # With a single schema, a constant belongs to the action.
        constant = [] if len(schemas) == 1 and scope.schema == WORLD else [()]
        for factors in (*constant, *((f,) for f in scope.fluents if lifted.numeric(f))):
            values = lifted.products(scope, factors, states, keys)
            if factors:
                spread = float(np.std(values[values != 0.0])) if values.any() else 0.0
                if spread <= 1e-9 * float(np.abs(values).max(initial=0.0)):
                    continue
                size = float(np.linalg.norm(values)) or 1.0
                linear.append((-abs(float(values @ rows.residuals)) / size, factors[0]))
                singles[factors[0]] = values
            effects.append(AddedEffect(scope.schema, target, factors))
            columns.append(unit * values)
        strongest = sorted(factor for _, factor in sorted(linear)[:_MAX_FACTORS])
        for pair in itertools.combinations_with_replacement(strongest, 2):
            effects.append(AddedEffect(scope.schema, target, pair))
            columns.append(unit * singles[pair[0]] * singles[pair[1]])

    world = lifted.world(symbol)
    offer(world, world.targets[0], after[rows.rows], rows.fluents)
    for name in schemas:
        scope = lifted.schema(name)
        for target in scope.targets:
            if target.symbol == symbol and may_change(lifted, scope, target):
                changed = {k: lifted.column(target, b) for k, b in scope.bindings.items()}
                fluent = np.array([changed.get(a, -1) for a in rows.groups.tolist()])
                keys = np.where(fluent == rows.fluents, rows.groups, -1)
                if (keys >= 0).sum() >= MIN_ROWS:
                    offer(scope, target, data.states[rows.rows], keys)
    fresh = [k for k, effect in enumerate(effects) if effect not in known]
    if not fresh:
        return [], np.empty((len(rows.rows), 0))
    return [effects[k] for k in fresh], np.stack([columns[k] for k in fresh], axis=1)


def may_change(lifted: LiftedModel, scope: LiftedScope, target: LiftedFluent) -> bool:
    """Return whether an effect can be added to what an action schema does to a fluent.

    It cannot if the schema scales the fluent, or assigns it under a condition or another name: an
    increase would contradict that.
    """
    schemas = lifted.syntax.schemas
    schema = next(s for s in schemas if s.kind is Kind.ACTION and s.name == scope.schema)
    assigned = any(
        isinstance(effect, ChangeFunction)
        and effect.change is Change.ASSIGN
        and effect.function.name == target.symbol
        and tuple(term.name for term in effect.function.arguments) == target.terms
        for effect in schema.effects
    )
    return not any(
        isinstance(effect, g.SetNumber)
        and effect.target == lifted.column(target, binding)
        and effect.change not in (Change.INCREASE, Change.DECREASE)
        and not (
            assigned and effect.change is Change.ASSIGN and effect.condition == g.Constant(True)
        )
        for key, binding in scope.bindings.items()
        for effect in lifted.ground.actions[key].effects
    )
