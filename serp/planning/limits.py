"""Bounds on the expansion of a planning graph."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

MAX_EDGES: Final = 4_000_000
"""Most edges that are tried."""
MAX_NUMBERS: Final = 10_000_000
"""Most numbers in all states that the edges of a graph lead to."""


class Bound(IntEnum):
    """What ended the expansion of the planning graph."""

    DEPTH = 0
    NODES = 1
    TIME = 2
    EXHAUSTED = 3


def node_budget(max_nodes: int, actions: int) -> int:
    """Return the most nodes to expand, with `actions` edges at each."""
    return max(1, min(max_nodes, MAX_EDGES // max(1, actions)))


def edge_budget(fluents: int) -> int:
    """Return the most edges of a graph whose states have `fluents` numbers.

    This bounds the memory: a layer that would exceed it is dropped, as by `max_nodes`.
    """
    return MAX_NUMBERS // (fluents + 1)
