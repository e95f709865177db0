"""Saving a closed planning graph, and restoring it from a checkpoint that may be damaged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved
from serp.planning.far_sight import closed_kernels as kernels
from serp.planning.far_sight.array_graph import ENDED, Counters, GraphArrays
from serp.planning.forecast import SAFE

_AT = Counters()
_FLAGS: Final = 2**53
_OF_NODES: Final = ("layer", "undefined", "value", "risk", "steps", "inside")
_OF_EDGES: Final = ("action", "flags", "reward", "hazard")
_OF_OUTCOMES: Final = ("target", "chance")


def contents(graph: GraphArrays, width: int) -> Arrays:
    """Return the filled part of a solved graph: what is not here follows from it."""
    nodes, expanded, edges, outcomes = (int(graph.counters[k]) for k in _AT)
    ends = {"first_edge": expanded + 1, "first_outcome": edges + 1, "states": nodes * width}
    ends |= dict.fromkeys(_OF_NODES, nodes) | dict.fromkeys(_OF_EDGES, edges)
    ends |= dict.fromkeys(_OF_OUTCOMES, outcomes)
    return {name: getattr(graph, name)[:end].copy() for name, end in ends.items()}


def restored(
    arrays: Mapping[str, NDArray[Any]],
    width: int,
    actions: int,
    spare: tuple[int, int, int],
    inert: NDArray[np.int64],
) -> GraphArrays:
    """Return the graph that `contents` was taken from.

    Args:
        arrays: What `contents` returned.
        width: Fluents of a state, F.
        actions: Number of actions.
        spare: Room for further nodes, edges and outcomes.
        inert: See `GraphArrays`.

    Raises:
        RunError: It is damaged.
    """
    saved = Saved("planning graph", arrays, {})
    first_edge = saved.array("first_edge", np.int64, (-1,), 0, MOST)
    first_outcome = saved.array("first_outcome", np.int64, (-1,), 0, MOST)
    layer = saved.array("layer", np.int32, (-1,), 0, MOST)
    nodes, expanded, edges = len(layer), len(first_edge) - 1, len(first_outcome) - 1
    outcomes = len(saved.array("chance", np.float64, (-1,), 0.0, 1.0))
    for name, first, end in (
        ("first_edge", first_edge, edges),
        ("first_outcome", first_outcome, outcomes),
    ):
        if not len(first) or first[0] != 0 or first[-1] != end or (np.diff(first) < 0).any():
            raise saved.wrong(f"{name} does not rise from 0 to {end}")
    if expanded > nodes:
        raise saved.wrong(f"{expanded} of {nodes} nodes are expanded")
    bounds: dict[str, tuple[int, float | None, float]] = {
        "states": (nodes * width, None, 0.0),
        "layer": (nodes, 0, MOST),
        "undefined": (nodes, 0, 1),
        "value": (nodes, None, 0.0),
        "risk": (nodes, 0.0, 1.0),
        "steps": (nodes, -1, SAFE),
        "inside": (nodes, 0, 1),
        "first_edge": (expanded + 1, 0, edges),
        "action": (edges, 0, actions - 1),
        "flags": (edges, 0, _FLAGS),
        "reward": (edges, None, 0.0),
        "hazard": (edges, 0.0, 1.0),
        "first_outcome": (edges + 1, 0, outcomes),
        "target": (outcomes, ENDED, nodes - 1),
        "chance": (outcomes, 0.0, 1.0),
    }
    room = (nodes + spare[0], edges + spare[1], outcomes + spare[2])
    graph = GraphArrays.allocate(*room, width, inert)
    for name, (length, low, high) in bounds.items():
        column = getattr(graph, name)
        part = saved.array(name, column.dtype, (length,), low, high)
        column[: len(part)] = part
    if graph.inside[expanded:].any():
        raise saved.wrong("a node that is not expanded is inside")
    graph.counters[:] = nodes, expanded, edges, outcomes
    kernels.hash_states(tuple(graph))
    return graph
