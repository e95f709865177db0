"""Which fluents make no difference to a plan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
from serp.model.transition_model import TransitionModel
from serp.pddl.syntax import Change

_SUMS = (Change.INCREASE, Change.DECREASE)


def inert_fluents(model: TransitionModel) -> NDArray[np.int64]:
    """Return the columns of the fluents that nothing depends on; none of an adapted model.

    No condition and no effect reads them. In the metric they may stand as terms of a sum, if they
    are only increased and decreased: the gain of the metric is then the same for all their values.
    """
    ground, read = model.ground, set[int]()
    if not model.as_written:
        return np.zeros(0, dtype=np.int64)
    for schema in ground.schemas:
        read |= g.reads(schema)
    if ground.goal is not None:
        read.update(g.fluents_of(ground.goal))
    if ground.metric is not None:
        read |= _not_added(ground.metric.value)
        terms = set(g.fluents_of(ground.metric.value))
        for effect in (effect for schema in ground.schemas for effect in schema.possible_effects):
            if effect.target in terms and getattr(effect, "change", None) not in _SUMS:
                read.add(effect.target)
    return np.array([k for k in range(len(ground.fluents)) if k not in read], dtype=np.int64)


def _not_added(value: g.Value) -> set[int]:
    """Return the fluents of an expression that are not terms of a sum with constant factors."""
    match value:
        case g.Operation("+" | "-", left, right):
            return _not_added(left) | _not_added(right)
        case g.Operation("*", left, right) if not set(g.fluents_of(left)):
            return _not_added(right)
        case g.Operation("*" | "/", left, right) if not set(g.fluents_of(right)):
            return _not_added(left)
        case g.Unary("-", operand):
            return _not_added(operand)
        case g.Operation() | g.Unary():
            return set(g.fluents_of(value))
        case _:
            return set()
