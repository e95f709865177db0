"""Bounds on the expansion of a planning graph."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from serp.settings import PlannerSettings

MAX_EDGES: Final = 4_000_000
"""Most edges that are tried."""
MAX_NUMBERS: Final = 10_000_000
"""Most numbers in all states that the edges of a graph lead to."""


class Bound(IntEnum):
    """What ended the expansion of the planning graph.

    `DEPTH`: so many layers were asked for. `NODES`, `TIME`: a budget was spent. `EXHAUSTED`: all
    that can be reached is in the graph. `CELLS`: the last layer, whose states have the values of a
    graph over cells, which holds all that is known and can be reached. `UNKNOWN`: the same, and
    nothing known there is worth more than going on, so the plan leads to what is not known, whose
    value is the most that there could be. `SAFETY`: nothing but whether actions are safe was asked.
    """

    DEPTH = 0
    NODES = 1
    TIME = 2
    EXHAUSTED = 3
    CELLS = 4
    UNKNOWN = 5
    SAFETY = 6

    @property
    def partial(self) -> bool:
        """Whether returns are partial: those of the lookahead, without what comes later."""
        return self in (Bound.DEPTH, Bound.NODES, Bound.TIME)


def node_budget(max_nodes: int, actions: int) -> int:
    """Return the most nodes to expand, with `actions` edges at each."""
    return max(1, min(max_nodes, MAX_EDGES // max(1, actions)))


def lookahead_nodes(settings: PlannerSettings, actions: int, fluents: int) -> int:
    """Return the most nodes that a lookahead expands: the budget, or the whole tree if smaller.

    Every node but the root has an edge that leads to it.
    """
    budget = min(node_budget(settings.max_nodes, actions), edge_budget(fluents) + 1)
    tree, layer = 0, 1
    for _ in range(settings.depth):
        tree += layer
        layer *= max(1, actions)
        if tree >= budget:
            return budget
    return tree


def edge_budget(fluents: int) -> int:
    """Return the most edges of a graph whose states have `fluents` numbers.

    This bounds the memory: a layer that would exceed it is dropped, as by `max_nodes`.
    """
    return MAX_NUMBERS // (fluents + 1)
