"""The compiled loop that expands a planning graph over cells of the state space.

The first real state that falls into a cell goes on from where it is (hybrid A*: Dolgov, Thrun,
Montemerlo & Diebel, International Journal of Robotics Research 29, 2010). An edge holds its action
until the cell changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import OUTCOMES, call_step, pointer_to
from serp.model.transition_model import UNKNOWN
from serp.planning.far_sight.array_graph import DONE, ENDED, FULL, Counters, GraphArrays
from serp.planning.far_sight.cell_values import Cells, digest_of, in_range, nearness
from serp.planning.hash_table import key_slot
from serp.planning.preference import compiled_joined, hazard, marked

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


MOVED = 1.0
"""Widths of a cell that an edge leads away from where it began, unless it ends by `HOLD`."""
HOLD = 16
"""Most control periods for which an edge holds its action."""
SMALL = 0.01
"""Weights in an interpolation that are a smaller fraction of the others are left out."""
_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


class CellArrays(NamedTuple):
    """What a graph over cells has beside `GraphArrays`; its edges hold their actions.

    Attributes:
        cell: `[N]` digests of the cells of nodes.
        reward: `[E]` discounted sums of rewards.
        periods: `[E]` discounted numbers of control periods.
        weight: `[E]` discount, but that of one period, of what follows.
        beyond: `[E]` discount of what follows an edge that leads to what is not known; else 0.
        target: Flat `[E * F]`, states that edges lead to.
        node: `[E]` the nodes of their cells, or `ENDED`.
    """

    cell: NDArray[np.uint64]
    reward: NDArray[np.float64]
    periods: NDArray[np.float64]
    weight: NDArray[np.float64]
    beyond: NDArray[np.float64]
    target: NDArray[np.float64]
    node: NDArray[np.int64]

    @classmethod
    def allocate(cls, nodes: int, edges: int, width: int) -> CellArrays:
        """Allocate room for so many nodes and edges."""
        cell = np.zeros(nodes, dtype=np.uint64)
        reward, periods, weight, beyond = (np.zeros(edges) for _ in range(4))
        target, node = np.zeros(edges * width), np.zeros(edges, dtype=np.int64)
        return cls(cell, reward, periods, weight, beyond, target, node)


@cached_njit(nogil=True, forceinline=True)
def _add_node(graph, cell, slot, digest, row, width):
    node = graph.counters[_NODES]
    graph.counters[_NODES] = node + 1
    graph.table[slot] = node
    cell[node] = digest
    for i in range(width):
        graph.states[node * width + i] = row[i]
    return node


@cached_njit(nogil=True)
def add_roots(arrays, division, found, states):
    """Add the cells of states, flat `[N * F]`, as far as there is room."""
    graph, cells, known = GraphArrays(*arrays), Cells(*division), CellArrays(*found).cell
    width = cells.low.shape[0]
    for k in range(states.shape[0] // width):
        row = pointer_to(states, k * width)
        digest = digest_of(row, cells.low, cells.scale, True, -1, 0)
        slot = key_slot(graph.table, known, digest)
        if graph.table[slot] < 0 and graph.counters[_NODES] < graph.layer.shape[0]:
            _add_node(graph, known, slot, digest, row, width)


@cached_njit(nogil=True)
def expand_cells(model, rules, arrays, division, found, room):
    """Expand nodes until all are expanded, the arrays are full, or enough steps were predicted.

    Args:
        model: `TransitionModel.machine_code`, and the address of its uncertainty; 0: everything is
            known.
        rules: Number of actions, discount, accepted risk, most steps to predict.
        arrays: Values of `GraphArrays`.
        division: Values of `Cells`.
        found: Values of `CellArrays`, written.
        room: `[2 (F + 1)]`, scratch memory.

    Returns:
        `DONE` or `FULL`, and the steps that were predicted.
    """
    graph, cells = GraphArrays(*arrays), Cells(*division)
    steps = 0
    held_edges = CellArrays(*found)
    seen, beyond, periods = held_edges.reward, held_edges.beyond, held_edges.periods
    (address, data, dt), doubts = model
    actions, discount, accepted, most = rules
    theta = pointer_to(data, 0)
    width = cells.low.shape[0]
    count = graph.counters
    now, out = pointer_to(room, 0), pointer_to(room, width + 1)
    while count[_EXPANDED] < count[_NODES]:
        node = count[_EXPANDED]
        if (
            count[_NODES] + actions > graph.layer.shape[0]
            or count[_EDGES] + actions > graph.action.shape[0]
            or steps >= most
        ):
            return FULL, steps
        graph.undefined[node] = 0
        source = pointer_to(graph.states, node * width)
        for action in range(actions):
            for i in range(width):
                now[i] = source[i]
            total, weight, length, danger, held = 0.0, 1.0, 0.0, 0.0, 0
            flags, ended, known = np.int64(0), False, True
            if doubts != 0:
                call_step(doubts, source, action, theta, dt, out)
                known = out[width] < UNKNOWN
            while held < HOLD:
                for i in range(width):
                    out[i] = now[i]
                out[width] = 0.0
                step = np.int64(call_step(address, now, action, theta, dt, out))
                steps += 1
                if not step & APPLICABLE:
                    if held == 0 and step & UNDEFINED:
                        graph.undefined[node] = 1
                    break
                further = hazard(step, accepted)
                step = marked(step, further)
                flags = step if held == 0 else np.int64(compiled_joined(flags, step))
                danger += (1.0 - danger) * further
                total += weight * out[width]
                length += weight
                weight *= discount
                held += 1
                for i in range(width):
                    now[i] = out[i]
                if step & TERMINAL:
                    ended = True
                    break
                far = not known
                for i in range(width):
                    moved = abs(now[i] - source[i])
                    if moved * cells.scale[i] >= MOVED or (moved > 0.0 and cells.scale[i] == 0.0):
                        far = True
                        break
                if far:
                    break
            if held == 0:
                continue
            edge = count[_EDGES]
            count[_EDGES] = edge + 1
            graph.action[edge], graph.flags[edge], graph.hazard[edge] = action, flags, danger
            seen[edge], periods[edge], beyond[edge] = total, length, 0.0
            held_edges.weight[edge] = weight / discount
            held_edges.node[edge] = ENDED
            for i in range(width):
                held_edges.target[edge * width + i] = now[i]
            if ended:
                continue
            if not (known and in_range(cells, now, width)):
                beyond[edge] = weight
                continue
            digest = digest_of(now, cells.low, cells.scale, True, -1, 0)
            slot = key_slot(graph.table, held_edges.cell, digest)
            if graph.table[slot] >= 0:
                held_edges.node[edge] = graph.table[slot]
            else:
                held_edges.node[edge] = _add_node(graph, held_edges.cell, slot, digest, now, width)
        count[_EXPANDED] = node + 1
        graph.first_edge[node + 1] = count[_EDGES]
    return DONE, steps


@cached_njit(nogil=True)
def interpolate(arrays, division, found):
    """Let every edge lead to the cells around the state that it reaches, weighted by nearness.

    A plan would otherwise gain up to a cell's width with every edge. Weights that are positive and
    sum to 1 keep value iteration a contraction (Gordon, ICML 1995). Small ones are left out.

    Args:
        arrays: Values of `GraphArrays`, expanded.
        division: Values of `Cells`.
        found: Values of `CellArrays`.
    """
    graph, cells, edges = GraphArrays(*arrays), Cells(*division), CellArrays(*found)
    width = cells.low.shape[0]
    outcome = 0
    graph.first_outcome[0] = 0
    for edge in range(graph.counters[_EDGES]):
        first = outcome
        if edges.node[edge] >= 0:
            at = edge * width
            row = edges.target[at : at + width]
            graph.target[first] = edges.node[edge]
            total = nearness(row, 0, graph.states, edges.node[edge] * width, cells.scale)
            graph.chance[first] = total
            outcome += 1
            for k in range(2 * width):
                if cells.scale[k // 2] <= 0.0 or outcome - first == OUTCOMES:
                    continue
                by = 1 - 2 * (k % 2)
                digest = digest_of(row, cells.low, cells.scale, True, k // 2, by)
                node = graph.table[key_slot(graph.table, edges.cell, digest)]
                if node >= 0:
                    near = nearness(row, 0, graph.states, node * width, cells.scale)
                    if near > SMALL * total:
                        graph.target[outcome], graph.chance[outcome] = node, near
                        outcome += 1
                        total += near
            for k in range(first, outcome):
                graph.chance[k] *= edges.weight[edge] / total
        graph.first_outcome[edge + 1] = outcome
    graph.counters[_OUTCOMES] = outcome
