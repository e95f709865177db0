"""Records that the compiled loops of planning read and write.

They are passed to the loops as plain tuples, which numba reads several times faster than named
tuples. The loops convert them back to records.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.planning.hash_table import table_size


class Rules(NamedTuple):
    """Limits of a search, and its treatment of rewards and risks; see `PlannerSettings`."""

    actions: int
    depth: int
    repeat: int
    discount: float
    accepted_risk: float
    max_nodes: int = 1
    max_edges: int = 1


class Scratch(NamedTuple):
    """Memory of one search: states, edges (`child` is -1 for none), best paths, hash table."""

    states: NDArray[np.float64]
    reward: NDArray[np.float64]
    weight: NDArray[np.float64]
    flags: NDArray[np.uint8]
    periods: NDArray[np.int32]
    risk: NDArray[np.float64]
    child: NDArray[np.int32]
    best_value: NDArray[np.float64]
    best_risk: NDArray[np.float64]
    best_steps: NDArray[np.int64]
    table: NDArray[np.int32]

    @classmethod
    def allocate(cls, nodes: int, actions: int, width: int) -> Scratch:
        """Allocate memory for searches that expand at most `nodes` nodes."""
        edges = nodes * actions
        return cls(
            states=np.zeros((nodes + 2) * (width + 1)),
            reward=np.zeros(edges),
            weight=np.zeros(edges),
            flags=np.zeros(edges, np.uint8),
            periods=np.zeros(edges, np.int32),
            risk=np.zeros(edges),
            child=np.zeros(edges, np.int32),
            best_value=np.zeros(nodes),
            best_risk=np.zeros(nodes),
            best_steps=np.zeros(nodes, np.int64),
            table=np.zeros(table_size(nodes), np.int32),
        )


class FirstActions(NamedTuple):
    """Results of a search for every first action, `[A]`; see `serp.Forecast`."""

    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]

    @classmethod
    def allocate(cls, count: int) -> FirstActions:
        """Allocate room for `count` actions."""
        return cls(
            np.empty(count), np.empty(count), np.empty(count, np.int64), np.empty(count),
            np.empty(count, np.int64),
        )  # fmt: skip
