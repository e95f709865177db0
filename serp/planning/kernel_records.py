"""Records that the compiled loops of planning read and write.

They are passed to the loops as plain tuples, which numba reads several times faster than named
tuples. The loops convert them back to records.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_Reals = NDArray[np.float64]
_Wholes = NDArray[np.int64]


class CompiledModel(NamedTuple):
    """A transition model, for compiled loops.

    Attributes:
        address: Address of its compiled transition function, see `serp.model.native`.
        data: Its parameters.
        dt: Its control period in seconds.
    """

    address: np.intp
    data: NDArray[np.float64]
    dt: float


class Rules(NamedTuple):
    """Limits of a search, and its treatment of rewards and risks; see `PlannerSettings`.

    Attributes:
        actions: Number of actions A.
        depth, repeat, discount, accepted_risk: As in the settings.
        max_nodes: Most nodes that are expanded.
        max_edges: Most applicable edges.
        always: Whether leaf values always count, and not only where all scores are equal.
    """

    actions: int
    depth: int
    repeat: int
    discount: float
    accepted_risk: float
    max_nodes: int = 1
    max_edges: int = 1
    always: bool = False


class Scratch(NamedTuple):
    """Memory of one search.

    Attributes:
        states: Flat `[(max_nodes + 2) * (F + 1)]`.
        reward, weight, flags, periods, risk: `[max_nodes * A]`, of every edge.
        child: `[max_nodes * A]` node that an edge leads to; -1 for none.
        best_value, best_risk, best_steps: `[max_nodes]`, of the best path from every node.
        table: Hash table, a power of two of at least twice max_nodes.
    """

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
        edges, size = nodes * actions, 2
        while size < 2 * nodes:
            size *= 2
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
            table=np.zeros(size, np.int32),
        )


class FirstActions(NamedTuple):
    """Results of a search for every first action, `[A]`; see `serp.planning.forecast.Forecast`."""

    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]


def room_for_actions(count: int) -> tuple[_Reals, _Reals, _Wholes, _Reals, _Wholes]:
    """Allocate the values of `FirstActions` for `count` actions."""
    return (
        np.empty(count), np.empty(count), np.empty(count, dtype=np.int64), np.empty(count),
        np.empty(count, dtype=np.int64),
    )  # fmt: skip
