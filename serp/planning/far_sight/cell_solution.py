"""The compiled loop that finds the values of cells, by modified policy iteration.

Between two sweeps over all edges come some over the best edges alone, which cost a fraction
(Puterman & Shin, Management Science 24, 1978).
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.planning.far_sight.cell_kernels import HeldEdges
from serp.planning.far_sight.closed_kernels import Counters, GraphArrays
from serp.planning.preference import rank_of

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

PRECISION = 1e-4
"""Iteration ends where no value changed by more than this fraction of the largest."""
SWEEPS = 100
"""Most sweeps over all edges."""
_EVALUATIONS = 4
"""Sweeps over the best edges after each of them."""
_NODES, _EXPANDED, _, _ = Counters()

_rank_of = cached_njit(nogil=True, forceinline=True)(rank_of)


@cached_njit(nogil=True, forceinline=True)
def _value_through(graph, held, edge, discount, worst):
    following = 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        following += graph.chance[k] * graph.value[graph.target[k]]
    danger = graph.hazard[edge]
    if danger > 0.0:
        following = (1.0 - danger) * following + danger * worst * held.weight[edge]
    return graph.reward[edge] + discount * following


@cached_njit(nogil=True)
def solve_cells(arrays, found, discount, worst, beyond):
    """Find the values of the cells.

    At every cell actions of the best rank are chosen among (see `serp.planning.preference`). The
    probabilities of what an edge leads to come from the division into cells as much as from the
    world. So risk is not minimised before all else, as in an exact graph, where it could only be
    avoided by never coming near anything; what is unsafe is worth the least that can be.

    Args:
        arrays: Values of `GraphArrays`, interpolated; `value` is continued from.
        found: Values of `HeldEdges`.
        discount: Weight of a reward one control period later.
        worst: Least value.
        beyond: Value of what is not known.
    """
    graph, held = GraphArrays(*arrays), HeldEdges(*found)
    expanded = graph.counters[_EXPANDED]
    allowed = np.zeros(graph.first_edge[expanded], dtype=np.uint8)
    for node in range(expanded):
        start, end = graph.first_edge[node], graph.first_edge[node + 1]
        lowest = np.int64(3)
        for edge in range(start, end):
            lowest = min(lowest, np.int64(_rank_of(graph.flags[edge])))
        for edge in range(start, end):
            allowed[edge] = np.int64(_rank_of(graph.flags[edge])) == lowest
            graph.reward[edge] = held.reward[edge] + beyond * held.beyond[edge]
        graph.best[node] = -1
        if start == end:
            graph.value[node] = worst if graph.undefined[node] else 0.0
    for sweep in range(SWEEPS):
        change = largest = 0.0
        for k in range(expanded):
            node = k if sweep % 2 else expanded - 1 - k
            most, best = -np.inf, np.int64(-1)
            for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
                if allowed[edge]:
                    value = _value_through(graph, held, edge, discount, worst)
                    if value > most:
                        most, best = value, np.int64(edge)
            if best >= 0:
                change = max(change, abs(most - graph.value[node]))
                largest = max(largest, abs(most))
                graph.value[node], graph.best[node] = most, best
        if change <= PRECISION * largest:
            return
        for again in range(_EVALUATIONS):
            for k in range(expanded):
                node = k if again % 2 else expanded - 1 - k
                if graph.best[node] >= 0:
                    graph.value[node] = _value_through(
                        graph, held, graph.best[node], discount, worst
                    )
