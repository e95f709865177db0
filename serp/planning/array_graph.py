"""The arrays of a compiled planning graph, and what all such graphs have in common."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import TransitionModel
from serp.pddl.syntax import Change
from serp.planning.hash_table import table_size
from serp.settings import PlannerSettings

_SUMS = (Change.INCREASE, Change.DECREASE)


def inert_fluents(ground: g.GroundModel) -> NDArray[np.int64]:
    """Return the columns of the fluents that nothing depends on.

    No condition and no effect reads them. In the metric they may stand as terms of a sum, if they
    are only increased and decreased: the gain of the metric is then the same for all their values.
    """
    read: set[int] = set()
    for schema in ground.schemas:
        read |= g.reads(schema)
    if ground.goal is not None:
        read.update(g.fluents_of(ground.goal))
    if ground.metric is not None:
        read |= _not_added(ground.metric.value)
        terms = set(g.fluents_of(ground.metric.value))
        for effect in (effect for schema in ground.schemas for effect in schema.effects):
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


ENDED = -1
"""In place of the node that an outcome leads to: the task ends."""
DONE, FULL, MANY = 0, 1, 2
"""What ended an expansion: every node is expanded, the arrays are full, or so many edges as were
allowed are there."""
NO_FLUENTS = np.zeros(0, dtype=np.int64)


class Counters(NamedTuple):
    """Positions in `GraphArrays.counters`."""

    nodes: int = 0
    expanded: int = 1
    edges: int = 2
    outcomes: int = 3


_NODES, _EXPANDED, _EDGES, _ = Counters()


class GraphArrays(NamedTuple):
    """A closed planning graph of up to N nodes, E edges and O outcomes.

    Attributes:
        counters: int64, see `Counters`.
        table: Hash table of the states, see `serp.planning.hash_table`.
        inert: Columns of fluents that make no difference, see `serp.planning.array_graph`;
            they are 0 in all states.
        states: Flat `[N * F]`.
        layer: `[N]` edges from the state that the node was first reached from.
        first_edge: `[N + 1]`.
        undefined: `[N]` whether the result of an action is undefined.
        dead_end: `[N]` whether damage is certain, whatever is done and whatever happens.
        action, flags, reward: `[E]` of edges.
        step_risk: `[E]`, 0 where the risk is accepted.
        first_outcome: `[E + 1]`.
        target: `[O]` node that an outcome leads to, or `ENDED`.
        chance: `[O]` its probability.
        value, risk, steps: `[N]` of the best policy, see `Forecast`.
        best: `[N]` its edge; -1 where no action is applicable.
        inside: `[N]` whether it stays among expanded nodes.
    """

    counters: NDArray[np.int64]
    table: NDArray[np.int32]
    inert: NDArray[np.int64]
    states: NDArray[np.float64]
    layer: NDArray[np.int32]
    first_edge: NDArray[np.int64]
    undefined: NDArray[np.uint8]
    dead_end: NDArray[np.uint8]
    action: NDArray[np.int32]
    flags: NDArray[np.int64]
    reward: NDArray[np.float64]
    step_risk: NDArray[np.float64]
    first_outcome: NDArray[np.int64]
    target: NDArray[np.int32]
    chance: NDArray[np.float64]
    value: NDArray[np.float64]
    risk: NDArray[np.float64]
    steps: NDArray[np.int64]
    best: NDArray[np.int64]
    inside: NDArray[np.uint8]

    @classmethod
    def allocate(
        cls,
        nodes: int,
        edges: int,
        outcomes: int,
        width: int,
        inert: NDArray[np.int64] = NO_FLUENTS,
    ) -> GraphArrays:
        """Allocate an empty graph."""
        return cls(
            counters=np.zeros(len(Counters()), dtype=np.int64),
            table=np.full(table_size(nodes), -1, dtype=np.int32),
            inert=inert,
            states=np.zeros(nodes * width),
            layer=np.zeros(nodes, dtype=np.int32),
            first_edge=np.zeros(nodes + 1, dtype=np.int64),
            undefined=np.zeros(nodes, dtype=np.uint8),
            dead_end=np.zeros(nodes, dtype=np.uint8),
            action=np.zeros(edges, dtype=np.int32),
            flags=np.zeros(edges, dtype=np.int64),
            reward=np.zeros(edges),
            step_risk=np.zeros(edges),
            first_outcome=np.zeros(edges + 1, dtype=np.int64),
            target=np.zeros(outcomes, dtype=np.int32),
            chance=np.zeros(outcomes),
            value=np.zeros(nodes),
            risk=np.zeros(nodes),
            steps=np.zeros(nodes, dtype=np.int64),
            best=np.zeros(nodes, dtype=np.int64),
            inside=np.zeros(nodes, dtype=np.uint8),
        )


class ArrayGraph:
    """A planning graph on arrays that compiled loops expand and solve.

    Args:
        model: The transition model.
        settings: Discount and accepted risk.
    """

    _arrays: GraphArrays

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._model = model
        self._settings = settings
        self._width = len(model.fluents)
        self._actions = len(model.actions)

    def _hold(self, arrays: GraphArrays) -> None:
        self._arrays, self._arrays_tuple = arrays, tuple(arrays)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return int(self._arrays.counters[_NODES])

    @property
    def expanded(self) -> int:
        """Number of nodes whose actions were followed."""
        return int(self._arrays.counters[_EXPANDED])

    @property
    def edges(self) -> int:
        """Number of edges."""
        return int(self._arrays.counters[_EDGES])
