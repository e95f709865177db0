"""What an edge of a closed planning graph and what follows it are worth: the backups of Bellman.

`graph` is a record of `serp.planning.far_sight.array_graph`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.planning.forecast import SAFE
from serp.planning.preference import compiled_rank_of

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_TINY = 1e-9


@cached_njit(nogil=True, forceinline=True)
def risk_of(graph, edge, discount):
    """Return the discounted risk of an edge and what follows it."""
    danger, following = graph.hazard[edge], 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        if graph.target[k] >= 0:
            following += graph.chance[k] * graph.risk[graph.target[k]]
    return danger + (1.0 - danger) * discount * following


@cached_njit(nogil=True, forceinline=True)
def value_of(graph, edge, discount):
    """Return the value of an edge and what follows it."""
    following = 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        if graph.target[k] >= 0:
            following += graph.chance[k] * graph.value[graph.target[k]]
    return graph.reward[edge] + discount * following


@cached_njit(nogil=True, forceinline=True)
def lasting_risk(graph, edge, node, discount):
    """Return the discounted risk of an edge that is taken again while it leads back to its node.

    The best edge has the least, as it has of `risk_of`.
    """
    danger, following, own = graph.hazard[edge], 0.0, 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target == node:
            own += graph.chance[k]
        elif target >= 0:
            following += graph.chance[k] * graph.risk[target]
    left = (1.0 - danger) * discount
    return (danger + left * following) / max(1.0 - left * own, _TINY)


@cached_njit(nogil=True, forceinline=True)
def lasting_value(graph, edge, node, discount):
    """Return the value of an edge that is taken again while it leads back to its node.

    It is the value to choose by. That of `value_of` is the same for the best edge, and less for
    any other; but to wait for nothing, at discount 1, would be worth what can be done afterwards,
    and so might be done for ever.
    """
    following, own = 0.0, 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target == node:
            own += graph.chance[k]
        elif target >= 0:
            following += graph.chance[k] * graph.value[target]
    total = graph.reward[edge] + discount * following
    if discount * own < 1.0 - _TINY:
        return total / (1.0 - discount * own)
    return total + graph.value[node] if total != 0.0 else 0.0


@cached_njit(nogil=True, forceinline=True)
def steps_through(graph, edge):
    """Return the control periods before the first risk on an edge and what follows it."""
    if graph.hazard[edge] > 0.0:
        return np.int64(0)
    least = np.int64(SAFE)
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target >= 0 and graph.steps[target] < least:
            least = graph.steps[target]
    return least if least == SAFE else least + 1


@cached_njit(nogil=True, forceinline=True)
def best_rank(graph, node):
    """Return the least rank of the edges of a node."""
    rank = np.int64(3)
    for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
        rank = min(rank, np.int64(compiled_rank_of(graph.flags[edge])))
    return rank


@cached_njit(nogil=True, forceinline=True)
def certain(graph, edge):
    """Return whether damage is certain after an edge."""
    if graph.hazard[edge] >= 1.0:
        return True
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target < 0 or not graph.doomed[target]:
            return False
    return True
