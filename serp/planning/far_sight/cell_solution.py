"""The compiled loop that finds the values of cells, by modified policy iteration.

Between two sweeps over all edges come some over the best edges alone, which cost a fraction
(Puterman & Shin, Management Science 24, 1978).
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.planning.backup_kernels import best_rank
from serp.planning.far_sight.array_graph import Counters, GraphArrays
from serp.planning.far_sight.cell_kernels import CellArrays
from serp.planning.far_sight.cell_values import CellValues, value_at
from serp.planning.preference import compiled_rank_of

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

PRECISION = 1e-4
"""Iteration ends where no value changed by more than this fraction of the largest."""
SWEEPS = 30
"""Most sweeps over all edges. Further ones continue from these values at the next build."""
_EVALUATIONS = 4
"""Sweeps over the best edges after each of them."""
_NODES, _EXPANDED, _EDGES, _OUTCOMES = Counters()


@cached_njit(nogil=True)
def _sweep(sources, edges, outcomes, values, backwards):
    """Find the values of all cells once, in one of two orders.

    Args:
        sources: `[n]` cells; `[n + 1]` where the edges of each begin.
        edges: Rewards and discounts of the edges, and where the outcomes of each begin.
        outcomes: Cells that they lead to and weights.
        values: `[N]` values of the cells; `[N]` their best edges, written.
        backwards: Whether the last cell comes first.

    Returns:
        The largest change, and the largest absolute value.
    """
    node_of, first_edge = sources
    reward, first_outcome = edges
    target, chance = outcomes
    value, best = values
    count = node_of.shape[0]
    change = largest = 0.0
    for k in range(count):
        at = count - 1 - k if backwards else k
        node = node_of[at]
        most, chosen = -np.inf, np.int64(-1)
        for edge in range(first_edge[at], first_edge[at + 1]):
            total = reward[edge]
            for o in range(first_outcome[edge], first_outcome[edge + 1]):
                total += chance[o] * value[target[o]]
            if total > most:
                most, chosen = total, np.int64(edge)
        change = max(change, abs(most - value[node]))
        largest = max(largest, abs(most))
        value[node], best[at] = most, chosen
    return change, largest


@cached_njit(nogil=True)
def _evaluate(sources, edges, outcomes, values, backwards):
    """Find the values of all cells once by their best edges; arguments as those of `_sweep`."""
    node_of = sources[0]
    reward, first_outcome = edges
    target, chance = outcomes
    value, best = values
    count = node_of.shape[0]
    for k in range(count):
        at = count - 1 - k if backwards else k
        edge = best[at]
        total = reward[edge]
        for o in range(first_outcome[edge], first_outcome[edge + 1]):
            total += chance[o] * value[target[o]]
        value[node_of[at]] = total


@cached_njit(nogil=True)
def begin_values(arrays, width, former, otherwise):
    """Begin with former values, if there are any.

    Args:
        arrays: Values of `GraphArrays`.
        width: Fluents, F.
        former: Values of `CellValues`.
        otherwise: The value if there are none.
    """
    graph, values = GraphArrays(*arrays), CellValues(*former)
    for node in range(graph.counters[_NODES]):
        graph.value[node] = otherwise
        if values.value.shape[0] > 0:
            graph.value[node] = value_at(values, graph.states, node * width)


@cached_njit(nogil=True)
def solve_cells(arrays, found, discount, worst, beyond):
    """Find the values of the cells.

    At every cell actions of the best rank are chosen among (see `serp.planning.preference`). The
    probabilities of what an edge leads to come from the division into cells as much as from the
    world. So risk is not minimised before all else, as in an exact graph, where it could only be
    avoided by never coming near anything; what is unsafe is worth the least that can be.

    Args:
        arrays: Values of `GraphArrays`, interpolated; `value` is continued from.
        found: Values of `CellArrays`.
        discount: Weight of a reward one control period later.
        worst: Least value.
        beyond: Value of what is not known.

    Returns:
        Number of sweeps over all edges.
    """
    graph, held = GraphArrays(*arrays), CellArrays(*found)
    expanded, all_edges = graph.counters[_EXPANDED], graph.counters[_EDGES]
    # Plain arrays of what is left to choose among: the loops run over them a hundred times.
    node_of, first_edge = np.empty(expanded, np.int64), np.zeros(expanded + 1, np.int64)
    reward, first_outcome = np.empty(all_edges), np.zeros(all_edges + 1, np.int64)
    target = np.empty(graph.counters[_OUTCOMES], np.int64)
    chance = np.empty(graph.counters[_OUTCOMES])
    count = edge_count = outcome_count = 0
    for node in range(expanded):
        start, end = graph.first_edge[node], graph.first_edge[node + 1]
        if start == end:
            graph.value[node] = worst if graph.undefined[node] else 0.0
            continue
        lowest = best_rank(graph, node)
        for edge in range(start, end):
            if np.int64(compiled_rank_of(graph.flags[edge])) > lowest:
                continue
            danger, weight = graph.hazard[edge], discount * held.weight[edge]
            reward[edge_count] = held.reward[edge] + (
                (1.0 - danger) * beyond * held.beyond[edge] + danger * worst * weight
            )
            for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
                target[outcome_count] = graph.target[k]
                chance[outcome_count] = (1.0 - danger) * discount * graph.chance[k]
                outcome_count += 1
            edge_count += 1
            first_outcome[edge_count] = outcome_count
        node_of[count] = node
        count += 1
        first_edge[count] = edge_count
    sources, edges, outcomes = (
        (node_of[:count], first_edge),
        (reward, first_outcome),
        (target, chance),
    )
    values = (graph.value, np.empty(count, np.int64))
    for sweep in range(SWEEPS):
        change, largest = _sweep(sources, edges, outcomes, values, sweep % 2 == 0)
        if change <= PRECISION * largest:
            break
        for again in range(_EVALUATIONS):
            _evaluate(sources, edges, outcomes, values, again % 2 == 0)
    return sweep
