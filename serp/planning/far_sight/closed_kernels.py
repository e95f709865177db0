"""The compiled loop that expands a closed planning graph.

Equal states are one node, however they are reached. Nodes are expanded in the order in which they
were found. Where the model counts outcomes, an edge leads to several nodes, each with its
probability. Records are passed as plain tuples, see `serp.planning.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, call_step, pointer_to
from serp.planning.far_sight.array_graph import DONE, ENDED, FULL, MANY, Counters, GraphArrays
from serp.planning.hash_table import state_slot
from serp.planning.preference import hazard, marked

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


@cached_njit(nogil=True, forceinline=True)
def state_node(graph, row, width):
    """Return the node with a state, adding it where there is none; inert fluents become 0.

    `graph` is a record with counters, table, inert and states, as `GraphArrays` has them.
    """
    for k in range(graph.inert.shape[0]):
        row[graph.inert[k]] = 0.0
    slot = state_slot(graph.table, graph.table.shape[0] - 1, graph.states, width, row, width)
    if graph.table[slot] >= 0:
        return np.int64(graph.table[slot])
    node = graph.counters[_NODES]
    graph.counters[_NODES] = node + 1
    graph.table[slot] = node
    for i in range(width):
        graph.states[node * width + i] = row[i]
    return node


@cached_njit(nogil=True)
def find(arrays, state):
    """Return the node with a state `[F]`, in which inert fluents are 0; -1 if there is none."""
    graph = GraphArrays(*arrays)
    width, mask = state.shape[0], graph.table.shape[0] - 1
    return np.int64(graph.table[state_slot(graph.table, mask, graph.states, width, state, width)])


@cached_njit(nogil=True)
def add_root(arrays, state):
    """Add a node with a state `[F]`, if there is none; there must be room."""
    state_node(GraphArrays(*arrays), state, state.shape[0])


@cached_njit(nogil=True)
def hash_states(arrays):
    """Fill an empty table with all nodes."""
    graph = GraphArrays(*arrays)
    width, mask = graph.states.shape[0] // graph.layer.shape[0], graph.table.shape[0] - 1
    for node in range(graph.counters[_NODES]):
        row = pointer_to(graph.states, node * width)
        graph.table[state_slot(graph.table, mask, graph.states, width, row, width)] = node


@cached_njit(nogil=True, forceinline=True)
def _add_outcome(graph, row, width, reward, terminal, chance, layer):
    """Add an outcome, the state `row`, to the newest edge."""
    edge = graph.counters[_EDGES] - 1
    outcome = graph.counters[_OUTCOMES]
    graph.counters[_OUTCOMES] = outcome + 1
    graph.first_outcome[edge + 1] = outcome + 1
    graph.reward[edge] += chance * reward
    graph.chance[outcome] = chance
    graph.target[outcome] = ENDED
    if not terminal:
        before = graph.counters[_NODES]
        node = state_node(graph, row, width)
        graph.target[outcome] = node
        if node == before:
            graph.layer[node] = layer


@cached_njit(nogil=True)
def expand(model, branches, rules, arrays, room, most):
    """Expand nodes until all are expanded, the arrays are full, or there are enough edges.

    Args:
        model: `TransitionModel.machine_code`.
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
    width = graph.states.shape[0] // graph.layer.shape[0]
    while graph.counters[_EXPANDED] < graph.counters[_NODES]:
        if graph.counters[_EDGES] >= most:
            return MANY
        if (
            graph.counters[_NODES] + actions * OUTCOMES > graph.layer.shape[0]
            or graph.counters[_EDGES] + actions > graph.action.shape[0]
            or graph.counters[_OUTCOMES] + actions * OUTCOMES > graph.target.shape[0]
        ):
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
            edge = graph.counters[_EDGES]
            graph.counters[_EDGES] = edge + 1
            danger = hazard(flags, accepted)
            graph.action[edge], graph.hazard[edge], graph.reward[edge] = action, danger, 0.0
            graph.flags[edge] = marked(flags, danger)
            graph.first_outcome[edge + 1] = graph.counters[_OUTCOMES]
            if branches == 0:
                _add_outcome(graph, out, width, out[width], flags & TERMINAL, 1.0, layer)
                continue
            count = call_step(branches, source, action, theta, dt, out)
            for k in range(count):
                row = pointer_to(room, k * (width + 3))
                ended = np.int64(row[width + 1]) & TERMINAL
                _add_outcome(graph, row, width, row[width], ended, row[width + 2], layer)
        graph.counters[_EXPANDED] = node + 1
        graph.first_edge[node + 1] = graph.counters[_EDGES]
    return DONE
