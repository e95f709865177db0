"""Terms that could be missing in a file, with what each of them would change.

A constant, every number in view, and products of two of those that have most to do with what is
left unexplained: of the world by itself, and of each action schema.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import Vector
from serp.pddl.syntax import Change, ChangeFunction, FunctionTerm, Kind
from serp.sysid.added_effects import AddedEffect
from serp.sysid.lifted_features import WORLD, Lens, Lifted, Lifting, features
from serp.sysid.parameter_fit import Rows
from serp.sysid.regression_data import RegressionData

_ALWAYS = g.Constant(True)
_PRODUCTS = 12  # most fluents whose products are looked at
FEW = 12
"""So few transitions tell nothing new."""


def candidates(
    lifting: Lifting,
    sample: RegressionData,
    after: Vector,
    rows: Rows,
    symbol: str,
    dt: float,
    known: Sequence[AddedEffect],
) -> tuple[list[AddedEffect], Vector]:
    """Return terms with their columns `[n, M]`: the changes that coefficient 1 would make.

    Args:
        lifting: The names of the file.
        sample: The transitions.
        after: `[N, F]` states once the action's effects are applied, which processes read.
        rows: The errors of one function.
        symbol: The function.
        dt: Control period.
        known: Terms that are left out.
    """
    schemas = sorted({lifting.ground.actions[a].schema for a in np.unique(rows.groups).tolist()})
    additions: list[AddedEffect] = []
    columns: list[Vector] = []

    def offer(lens: Lens, target: Lifted, states: Vector, keys: NDArray[np.int64]) -> None:
        unit = dt if lens.schema == WORLD else 1.0
        linear: list[tuple[float, Lifted]] = []
        singles: dict[Lifted, Vector] = {}
        for factors in _linear(lens, lifting, alone=len(schemas) == 1):
            values = features(lifting, lens, factors, states, keys)
            if factors:
                spread = float(np.std(values[values != 0.0])) if values.any() else 0.0
                if spread <= 1e-9 * float(np.abs(values).max(initial=0.0)):
                    continue
                size = float(np.linalg.norm(values)) or 1.0
                linear.append((-abs(float(values @ rows.residuals)) / size, factors[0]))
                singles[factors[0]] = values
            additions.append(AddedEffect(lens.schema, target, factors))
            columns.append(unit * values)
        strongest = sorted(factor for _, factor in sorted(linear)[:_PRODUCTS])
        for pair in itertools.combinations_with_replacement(strongest, 2):
            additions.append(AddedEffect(lens.schema, target, pair))
            columns.append(unit * singles[pair[0]] * singles[pair[1]])

    world = lifting.world(symbol)
    offer(world, world.targets[0], after[rows.rows], rows.fluents)
    for name in schemas:
        lens = lifting.schema(name)
        for target in lens.targets:
            if target.symbol == symbol and may_change(lifting, lens, target):
                meant = {k: lifting.column(target, b) for k, b in lens.bindings.items()}
                fluent = np.array([meant.get(a, -1) for a in rows.groups.tolist()])
                keys = np.where(fluent == rows.fluents, rows.groups, -1)
                if (keys >= 0).sum() >= FEW:
                    offer(lens, target, sample.states[rows.rows], keys)
    fresh = [k for k, a in enumerate(additions) if a not in known]
    if not fresh:
        return [], np.empty((len(rows.rows), 0))
    return [additions[k] for k in fresh], np.stack([columns[k] for k in fresh], axis=1)


def _linear(lens: Lens, lifting: Lifting, *, alone: bool) -> Iterator[tuple[Lifted, ...]]:
    """Yield no factor and one factor; with a single schema, what is constant is the action's."""
    if not (alone and lens.schema == WORLD):
        yield ()
    for lifted in lens.view:
        if lifting.syntax.declarations[lifted.symbol].numeric:
            yield (lifted,)


def may_change(lifting: Lifting, lens: Lens, target: Lifted) -> bool:
    """Whether a term can be added to what an action schema does to a fluent.

    Not where it scales the fluent, or assigns it in some cases and not in others, be it under
    another name: no increase goes with that.
    """
    schema = next(
        s for s in lifting.syntax.schemas if s.kind is Kind.ACTION and s.name == lens.schema
    )
    assigned = any(
        isinstance(effect, ChangeFunction)
        and effect.change is Change.ASSIGN
        and _lifted(effect.function) == target
        for effect in schema.effects
    )
    return not any(
        isinstance(effect, g.SetNumber)
        and effect.target == lifting.column(target, binding)
        and effect.change not in (Change.INCREASE, Change.DECREASE)
        and not (assigned and effect.change is Change.ASSIGN and effect.condition == _ALWAYS)
        for key, binding in lens.bindings.items()
        for effect in lifting.ground.actions[key].effects
    )


def _lifted(function: FunctionTerm) -> Lifted:
    return Lifted(function.name, tuple(term.name for term in function.arguments))
