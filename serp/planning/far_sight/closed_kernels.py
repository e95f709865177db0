"""The arrays of a closed planning graph, and the compiled loop that expands it.

Equal states are one node, however they are reached. Nodes are expanded in the order in which they
were found. Where the model counts outcomes, an edge leads to several nodes, each with its
probability. Records are passed as plain tuples, see `serp.planning.kernel_records`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, call_step, pointer_to
from serp.planning.preference import hazard, marked

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

ENDED = -1
"""In place of the node that an outcome leads to: the task ends."""
DONE, FULL, MANY = 0, 1, 2
"""What ended an expansion: every node is expanded, the arrays are full, or so many edges as were
allowed are there."""
NO_FLUENTS = np.zeros(0, dtype=np.int64)

_hazard = cached_njit(nogil=True, forceinline=True)(hazard)
_marked = cached_njit(nogil=True, forceinline=True)(marked)


class Counters(NamedTuple):
    """Positions in `GraphArrays.counters`."""

    nodes: int = 0
    expanded: int = 1
    edges: int = 2
    outcomes: int = 3


_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


class GraphArrays(NamedTuple):
    """A closed planning graph of up to N nodes, E edges and O outcomes.

    Attributes:
        counters: int64, see `Counters`.
        table: Hash table of the states, a power of two of at least 2 N; -1 for an empty slot.
        inert: Columns of fluents that make no difference, see `serp.planning.far_sight.inert`;
            they are 0 in all states.
        states: Flat `[N * F]`.
        digest: `[N]` hashes of the states.
        layer: `[N]` edges from the state that the node was first reached from.
        first_edge: `[N + 1]`.
        undefined: `[N]` whether the result of an action is undefined.
        action, flags, reward, hazard: `[E]` of edges; `hazard` is 0 where the risk is accepted.
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
    digest: NDArray[np.uint64]
    layer: NDArray[np.int32]
    first_edge: NDArray[np.int64]
    undefined: NDArray[np.uint8]
    action: NDArray[np.int32]
    flags: NDArray[np.int64]
    reward: NDArray[np.float64]
    hazard: NDArray[np.float64]
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
        size = 2
        while size < 2 * nodes:
            size *= 2
        return cls(
            counters=np.zeros(len(Counters()), dtype=np.int64),
            table=np.full(size, -1, dtype=np.int32),
            inert=inert,
            states=np.zeros(nodes * width),
            digest=np.zeros(nodes, dtype=np.uint64),
            layer=np.zeros(nodes, dtype=np.int32),
            first_edge=np.zeros(nodes + 1, dtype=np.int64),
            undefined=np.zeros(nodes, dtype=np.uint8),
            action=np.zeros(edges, dtype=np.int32),
            flags=np.zeros(edges, dtype=np.int64),
            reward=np.zeros(edges),
            hazard=np.zeros(edges),
            first_outcome=np.zeros(edges + 1, dtype=np.int64),
            target=np.zeros(outcomes, dtype=np.int32),
            chance=np.zeros(outcomes),
            value=np.zeros(nodes),
            risk=np.zeros(nodes),
            steps=np.zeros(nodes, dtype=np.int64),
            best=np.zeros(nodes, dtype=np.int64),
            inside=np.zeros(nodes, dtype=np.uint8),
        )


@cached_njit(nogil=True, forceinline=True)
def _digest_of(row, width):
    digest = np.uint64(0xCBF29CE484222325)
    for i in range(width):
        bits = np.float64(row[i] + 0.0).view(np.uint64)  # -0.0 equals 0.0
        digest = (digest ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        digest ^= digest >> np.uint64(29)
    digest ^= digest >> np.uint64(32)
    digest *= np.uint64(0x9E3779B97F4A7C15)
    digest ^= digest >> np.uint64(29)
    return digest


@cached_njit(nogil=True, forceinline=True)
def _slot_of(graph, row, digest, width):
    """Return the slot of the node with a state, or the empty slot for it."""
    mask = graph.table.shape[0] - 1
    slot = np.int64(digest & np.uint64(mask))
    while graph.table[slot] >= 0:
        node = np.int64(graph.table[slot])
        if graph.digest[node] == digest:
            equal = True
            for i in range(width):
                if graph.states[node * width + i] != row[i]:
                    equal = False
                    break
            if equal:
                break
        slot = (slot + 1) & mask
    return slot


@cached_njit(nogil=True, forceinline=True)
def hashed_node(graph, row, width, layer):
    """Return the node with a state, adding it where there is none; inert fluents become 0."""
    for k in range(graph.inert.shape[0]):
        row[graph.inert[k]] = 0.0
    digest = _digest_of(row, width)
    slot = _slot_of(graph, row, digest, width)
    if graph.table[slot] >= 0:
        return np.int64(graph.table[slot])
    node = graph.counters[_NODES]
    graph.counters[_NODES] = node + 1
    graph.table[slot] = node
    graph.digest[node] = digest
    graph.layer[node] = layer
    for i in range(width):
        graph.states[node * width + i] = row[i]
    return node


@cached_njit(nogil=True)
def find(arrays, state):
    """Return the node with a state `[F]`, in which inert fluents are 0; -1 if there is none."""
    graph = GraphArrays(*arrays)
    width = state.shape[0]
    return np.int64(graph.table[_slot_of(graph, state, _digest_of(state, width), width)])


@cached_njit(nogil=True)
def add_root(arrays, state):
    """Return the node with a state `[F]`, adding it where there is none; there must be room."""
    return hashed_node(GraphArrays(*arrays), state, state.shape[0], 0)


@cached_njit(nogil=True)
def hash_states(arrays):
    """Find the digests of all nodes, and fill an empty table with them."""
    graph = GraphArrays(*arrays)
    width = graph.states.shape[0] // graph.digest.shape[0]
    mask = graph.table.shape[0] - 1
    for node in range(graph.counters[_NODES]):
        row = pointer_to(graph.states, node * width)
        digest = _digest_of(row, width)
        graph.digest[node] = digest
        slot = np.int64(digest & np.uint64(mask))
        while graph.table[slot] >= 0:
            slot = (slot + 1) & mask
        graph.table[slot] = node


@cached_njit(nogil=True)
def add_edge(arrays, action, flags, accepted):
    """Add an edge out of the node that is being expanded; its outcomes follow by `add_outcome`."""
    graph = GraphArrays(*arrays)
    _add_edge(graph, action, flags, accepted)


@cached_njit(nogil=True, forceinline=True)
def _add_edge(graph, action, flags, accepted):
    edge = graph.counters[_EDGES]
    graph.counters[_EDGES] = edge + 1
    danger = _hazard(flags, accepted)
    graph.action[edge] = action
    graph.flags[edge] = _marked(flags, danger)
    graph.hazard[edge] = danger
    graph.reward[edge] = 0.0
    graph.first_outcome[edge + 1] = graph.counters[_OUTCOMES]


@cached_njit(nogil=True)
def add_outcome(arrays, row, reward, terminal, chance, layer):
    """Add an outcome, the state `row` `[F]`, to the newest edge."""
    _add_outcome(GraphArrays(*arrays), row, row.shape[0], reward, terminal, chance, layer)


@cached_njit(nogil=True, forceinline=True)
def _add_outcome(graph, row, width, reward, terminal, chance, layer):
    edge = graph.counters[_EDGES] - 1
    outcome = graph.counters[_OUTCOMES]
    graph.counters[_OUTCOMES] = outcome + 1
    graph.first_outcome[edge + 1] = outcome + 1
    graph.reward[edge] += chance * reward
    graph.chance[outcome] = chance
    graph.target[outcome] = ENDED
    if not terminal:
        graph.target[outcome] = hashed_node(graph, row, width, layer)


@cached_njit(nogil=True)
def close_node(arrays):
    """End the expansion of a node; the next one follows."""
    _close_node(GraphArrays(*arrays))


@cached_njit(nogil=True, forceinline=True)
def _close_node(graph):
    node = graph.counters[_EXPANDED]
    graph.counters[_EXPANDED] = node + 1
    graph.first_edge[node + 1] = graph.counters[_EDGES]


@cached_njit(nogil=True, forceinline=True)
def _has_room(graph, actions):
    """Whether the arrays have room for all edges and outcomes of one node."""
    count = graph.counters
    most = actions * OUTCOMES
    return (
        count[_NODES] + most <= graph.digest.shape[0]
        and count[_EDGES] + actions <= graph.action.shape[0]
        and count[_OUTCOMES] + most <= graph.target.shape[0]
    )


@cached_njit(nogil=True)
def has_room(arrays, actions):
    """Return whether there is room for all edges and outcomes of one node."""
    return _has_room(GraphArrays(*arrays), actions)


@cached_njit(nogil=True)
def expand(model, branches, rules, arrays, room, most):
    """Expand nodes until all are expanded, the arrays are full, or there are enough edges.

    Args:
        model: Values of `serp.planning.kernel_records.CompiledModel`.
        branches: Address of the compiled function that gives all outcomes of a step, see
            `TransitionModel.native_outcomes`; 0 where the model has one outcome a step.
        rules: Number of actions A, accepted risk.
        arrays: Values of `GraphArrays`.
        room: Flat, `OUTCOMES` rows of F + 3 numbers: states, then reward, flags and probability.
        most: No node is expanded when there are so many edges.

    Returns:
        `DONE`, `FULL` or `MANY`.
    """
    graph = GraphArrays(*arrays)
    actions, accepted = rules
    address, data, dt = model
    theta = pointer_to(data, 0)
    width = graph.states.shape[0] // graph.digest.shape[0]
    while graph.counters[_EXPANDED] < graph.counters[_NODES]:
        if graph.counters[_EDGES] >= most:
            return MANY
        if not _has_room(graph, actions):
            return FULL
        node = graph.counters[_EXPANDED]
        layer = graph.layer[node] + 1
        graph.undefined[node] = 0
        source, out = pointer_to(graph.states, node * width), pointer_to(room, 0)
        changed = True
        for action in range(actions):
            if changed:  # an action whose precondition fails changes nothing
                for i in range(width):
                    out[i] = source[i]
                out[width] = 0.0
            flags = call_step(address, source, action, theta, dt, out)
            changed = flags != 0
            if not flags & APPLICABLE:
                if flags & UNDEFINED:
                    graph.undefined[node] = 1
                continue
            _add_edge(graph, action, flags, accepted)
            if branches == 0:
                _add_outcome(graph, out, width, out[width], flags & TERMINAL, 1.0, layer)
                continue
            count = call_step(branches, source, action, theta, dt, out)
            for k in range(count):
                row = pointer_to(room, k * (width + 3))
                ended = np.int64(row[width + 1]) & TERMINAL
                _add_outcome(graph, row, width, row[width], ended, row[width + 2], layer)
        _close_node(graph)
    return DONE
