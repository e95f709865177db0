"""The arrays of a compiled planning graph, and what all such graphs have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved
from serp.model import ground_model as g
from serp.model.transition_model import TransitionModel
from serp.pddl.syntax import Change
from serp.planning.forecast import SAFE
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
        length_of = _lengths((nodes, nodes, edges, outcomes), width)
        columns = {
            name: np.zeros(length_of[per], dtype) for name, (dtype, per, *_) in _COLUMNS.items()
        }
        counters = np.zeros(len(Counters()), dtype=np.int64)
        table = np.full(table_size(nodes), -1, dtype=np.int32)
        return cls(counters=counters, table=table, inert=inert, **columns)


# Saved graphs ------------------------------------------------------------------------------------

_COLUMNS: Final[dict[str, tuple[str, str, float | None, float]]] = {
    "states": ("f8", "numbers", None, 0.0),
    "layer": ("i4", "nodes", 0, MOST),
    "undefined": ("u1", "nodes", 0, 1),
    "value": ("f8", "nodes", None, 0.0),
    "risk": ("f8", "nodes", 0.0, 1.0),
    "steps": ("i8", "nodes", -1, SAFE),
    "inside": ("u1", "nodes", 0, 1),
    "first_edge": ("i8", "sources", 0, MOST),
    "action": ("i4", "edges", 0, MOST),
    "flags": ("i8", "edges", 0, 2**53),
    "reward": ("f8", "edges", None, 0.0),
    "step_risk": ("f8", "edges", 0.0, 1.0),
    "first_outcome": ("i8", "ends", 0, MOST),
    "target": ("i4", "outcomes", ENDED, MOST),
    "chance": ("f8", "outcomes", 0.0, 1.0),
    "dead_end": ("u1", "nodes", 0, 1),
    "best": ("i8", "nodes", -1, MOST),
}
"""Type of each column, what its length is, see `_lengths`, and the least and largest number."""
_DERIVED: Final = ("dead_end", "best")
"""Columns that are not saved: they follow from the others."""


def _lengths(counts: Sequence[int], width: int) -> dict[str, int]:
    nodes, expanded, edges, outcomes = counts
    return {
        "numbers": nodes * width, "nodes": nodes, "sources": expanded + 1, "edges": edges,
        "ends": edges + 1, "outcomes": outcomes,
    }  # fmt: skip


def contents(graph: GraphArrays, width: int) -> Arrays:
    """Return the filled part of a solved graph."""
    ends = _lengths(graph.counters.tolist(), width)
    return {
        name: getattr(graph, name)[: ends[per]].copy()
        for name, (_, per, *_) in _COLUMNS.items()
        if name not in _DERIVED
    }


def restored(
    arrays: Mapping[str, NDArray[Any]],
    width: int,
    actions: int,
    spare: tuple[int, int, int],
    inert: NDArray[np.int64],
) -> GraphArrays:
    """Return the graph that `contents` was taken from, with an empty hash table.

    Args:
        arrays: What `contents` returned.
        width: Fluents of a state, F.
        actions: Number of actions.
        spare: Room for further nodes, edges and outcomes.
        inert: See `GraphArrays`.

    Raises:
        RunError: It is damaged.
    """
    saved = Saved("planning graph", arrays, {})
    columns = {
        name: saved.array(name, dtype, (-1,), low, high)
        for name, (dtype, _, low, high) in _COLUMNS.items()
        if name not in _DERIVED
    }
    nodes, edges, outcomes = (len(columns[name]) for name in ("layer", "action", "target"))
    counts = nodes, len(columns["first_edge"]) - 1, edges, outcomes
    ends = _lengths(counts, width)
    for name, column in columns.items():
        if len(column) != ends[_COLUMNS[name][1]]:
            raise saved.wrong(f"{name} has {len(column)} entries, not {ends[_COLUMNS[name][1]]}")
    for name, end in (("first_edge", edges), ("first_outcome", outcomes)):
        first = columns[name]
        if not len(first) or first[0] != 0 or first[-1] != end or (np.diff(first) < 0).any():
            raise saved.wrong(f"{name} does not rise from 0 to {end}")
    for name, end in (("action", actions), ("target", nodes)):
        if columns[name].max(initial=-1) >= end:
            raise saved.wrong(f"{name} has an entry that is not below {end}")
    if counts[1] > nodes or columns["inside"][counts[1] :].any():
        raise saved.wrong(f"{counts[1]} of {nodes} nodes are expanded, and more are inside")
    graph = GraphArrays.allocate(
        nodes + spare[0], edges + spare[1], outcomes + spare[2], width, inert
    )
    for name, column in columns.items():
        getattr(graph, name)[: len(column)] = column
    graph.counters[:] = counts
    return graph


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
