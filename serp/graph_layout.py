"""What of a planning graph a picture shows, and where: the geometry of `serp.drawing`.

A graph is laid out as a tree from left to right: a column a layer, a row a leaf, everything else
amid its children. Equal states are one node, so a graph is no tree: the first edge that reaches a
node places it, the others cross over to it.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import networkx as nx

MAX_EDGES: Final = 200
"""Edges that are shown at most."""
MAX_FAN: Final = 24
"""Edges out of one state that are shown at most, the best ones."""

# Inches.
LINE: Final = 0.15
_CHARACTER = 0.068
_ROOMY, _TIGHT = 0.175, 0.1
_TURN = 0.45  # in which an edge turns from its source to the row of its target
_MANY_ROWS = 72  # above which rows are tight


@dataclass
class ShownEdge:
    """An edge with what its looks depend on.

    Attributes:
        source, target: Nodes.
        action: Position of the action.
        name: Its name.
        chosen: Whether it is on the best path.
        unsafe: Whether it is predicted unsafe.
        doomed: Whether something unsafe follows later on, whatever is done.
        total: Discounted sum of rewards of the best path through it, from the root.
        promise: `total` between the worst (0) and the best (1) of the safe edges; 0 for others.
        label: Text above it; may be empty.
    """

    source: int
    target: int
    action: int
    name: str
    chosen: bool
    unsafe: bool
    doomed: bool
    total: float
    promise: float = 1.0
    label: str = ""

    @property
    def rank(self) -> tuple[bool, bool, bool, float, int]:
        """Sorts the best first."""
        return (not self.chosen, self.unsafe, self.doomed, -self.total, self.action)


@dataclass(frozen=True)
class Layout:
    """What is shown, and where; positions in inches from the upper left corner of the graph.

    Attributes:
        edges: The edges, by source and action.
        x, y: Node → position.
        turns: Layer → where its edges have reached the rows of their targets.
        collapsed: Nodes whose continuation is not shown.
        fans_cut: Whether edges are left out beside others of the same source.
        bare: Whether there are edges without a label.
        width, height: Of the graph.
    """

    edges: list[ShownEdge]
    x: dict[int, float]
    y: dict[int, float]
    turns: list[float]
    collapsed: list[int]
    fans_cut: bool
    bare: bool
    width: float
    height: float


def lay_out(graph: nx.MultiDiGraph, weight: float, labels: Mapping[int, str]) -> Layout:
    """Choose what to show of a planning graph, and place it.

    Args:
        graph: See `PlanningGraph.to_networkx`.
        weight: What a reward one edge later is worth.
        labels: Action → label of its edge out of the root; other edges bear their name.
    """
    edges = _edges(graph, weight)
    shown, collapsed, cut = _select(graph, edges)
    rows = _rows(shown)
    row = _ROOMY if max(rows.values()) < _MANY_ROWS else _TIGHT
    drawn = [edge for node in sorted(shown) for edge in shown[node]]
    layers: dict[int, list[ShownEdge]] = {}
    for edge in drawn:
        layers.setdefault(graph.nodes[edge.source]["layer"], []).append(edge)
    columns, turns = [0.0], []
    for layer in sorted(layers):
        room = _least_gap([rows[edge.target] for edge in layers[layer]]) * row >= LINE
        for edge in layers[layer]:
            if room or edge.chosen:
                edge.label = labels[edge.action] if edge.source == 0 else _short(edge.name)
        longest = max(len(edge.label) for edge in layers[layer])
        turns.append(columns[-1] + _TURN + (0 if room else 0.35))
        columns.append(turns[-1] + 0.25 + _CHARACTER * longest)
    return Layout(
        edges=drawn,
        x={node: columns[graph.nodes[node]["layer"]] for node in rows},
        y={node: row * place for node, place in rows.items()},
        turns=turns,
        collapsed=collapsed,
        fans_cut=cut,
        bare=not all(edge.label for edge in drawn),
        width=columns[-1],
        height=row * max(rows.values()),
    )


def short(name: str, longest: int = 26) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= longest else name[: longest - 1] + "…"


_short = short


def _edges(graph: nx.MultiDiGraph, weight: float) -> dict[int, list[ShownEdge]]:
    """Return the edges out of every node, by action."""
    # Nodes are numbered layer by layer, so that a source is reached before it is left.
    reached = dict.fromkeys(graph, float("-inf"))
    reached[0] = 0.0
    leaving: dict[int, list[ShownEdge]] = {}
    for source in sorted(graph):
        scale = weight ** graph.nodes[source]["layer"]
        for _, target, action, data in graph.out_edges(source, keys=True, data=True):
            so_far = reached[source] + scale * data["reward"]
            reached[target] = max(reached[target], so_far)
            goal = graph.nodes[target]
            edge = ShownEdge(
                source=source,
                target=target,
                action=action,
                name=data["action"],
                chosen=data["chosen"],
                unsafe=data["unsafe"],
                doomed=goal["safe_steps"] is not None and not data["unsafe"],
                total=so_far + scale * weight * goal["value"],
            )
            leaving.setdefault(source, []).append(edge)
        leaving.get(source, []).sort(key=lambda edge: edge.action)
    _set_promise([edge for fan in leaving.values() for edge in fan])
    return leaving


def _set_promise(edges: Sequence[ShownEdge]) -> None:
    safe = [edge.total for edge in edges if not (edge.unsafe or edge.doomed)]
    low, high = (min(safe), max(safe)) if safe else (0.0, 0.0)
    for edge in edges:
        if edge.unsafe or edge.doomed:
            edge.promise = 0.0
        elif high > low:
            edge.promise = (edge.total - low) / (high - low)


def _select(
    graph: nx.MultiDiGraph, leaving: Mapping[int, list[ShownEdge]]
) -> tuple[dict[int, list[ShownEdge]], list[int], bool]:
    """Choose edges: those along the best path, then layer by layer those out of the best states.

    Returns:
        The edges shown out of each node, the nodes whose edges are not shown, and whether a node
        has more edges than are shown of it.
    """
    shown: dict[int, list[ShownEdge]] = {}
    collapsed: list[int] = []
    cut = False
    count = 0
    waiting: list[tuple[Any, ...]] = [(False, 0, (), 0)]
    seen = {0}
    while waiting:
        *_, node = heapq.heappop(waiting)
        fan = sorted(leaving.get(node, ()), key=lambda edge: edge.rank)
        if not fan:
            continue
        cut = cut or len(fan) > MAX_FAN
        fan = fan[:MAX_FAN]
        if not fan[0].chosen and count + len(fan) > MAX_EDGES:
            collapsed.append(node)
            continue
        count += len(fan)
        shown[node] = sorted(fan, key=lambda edge: edge.action)
        for edge in fan:
            if edge.target not in seen:
                seen.add(edge.target)
                layer = graph.nodes[edge.target]["layer"]
                heapq.heappush(waiting, (not edge.chosen, layer, edge.rank, edge.target))
    return shown, sorted(collapsed), cut


def _rows(shown: Mapping[int, list[ShownEdge]]) -> dict[int, float]:
    """Return the row of every node: leaves one below the other, others amid their children."""
    children: dict[int, list[int]] = {}
    placed = {0}
    for node in sorted(shown):
        for edge in shown[node]:
            if edge.target not in placed:
                placed.add(edge.target)
                children.setdefault(node, []).append(edge.target)
    rows: dict[int, float] = {}
    leaves = 0
    waiting = [0]
    order = []
    while waiting:
        node = waiting.pop()
        order.append(node)
        waiting += reversed(children.get(node, []))
        if node not in children:
            rows[node] = float(leaves)
            leaves += 1
    for node in reversed(order):
        if node in children:
            rows[node] = (rows[children[node][0]] + rows[children[node][-1]]) / 2
    return rows


def _least_gap(rows: Sequence[float]) -> float:
    places = sorted(set(rows))
    gaps = [after - before for before, after in zip(places, places[1:], strict=False)]
    return min(gaps, default=float("inf"))
