"""The layout of a planning graph for `serp.viz.plan_drawing`.

A graph is laid out as a tree from left to right: one column per layer, one row per leaf; an inner
node is centred on its children. Equal states of a layer are one node; its children are shown once,
behind the best edge that reaches it, and the other edges end there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from serp._util.number_format import percent

if TYPE_CHECKING:
    import networkx as nx

MAX_EDGES: Final = 160
"""Largest number of edges shown; five actions to depth three are 155."""
MAX_FAN: Final = 24
"""Largest number of edges shown out of one state; the best ones are shown."""
HARMS: Final = ("unsafe", "risky", "doomed")
"""Flagged by the file; with a risk that is not accepted; leading to something unsafe later on,
whatever is done."""

_LONGEST: Final = 26  # characters of a label
_LABELLED: Final = 130  # most rows in which every edge has a label
_BARE: Final = 0.5  # rows that an edge without a label takes
_APART: Final = 0.3  # rows between the branches of two states


@dataclass(eq=False)
class Branch:
    """An edge of the graph with its style and its place.

    Attributes:
        source, target: Nodes.
        layer: The source's layer.
        action: Position of the action.
        label: Text above it; may be empty.
        chosen: Whether it is on the best path.
        harm: One of `HARMS`, or empty.
        so_far: Discounted sum of the rewards from the root along what is shown.
        total: The same with the best that follows.
        value: `total` between low (0) and the best (1); 0 for what is harmful.
        end: What is at its end: `leaf`, `ended` (the task), `fork` (more branches), `elsewhere`
            (its state is shown elsewhere with what follows) or `collapsed` (what follows is not
            shown).
        parent: The branch before it; None at the root.
        children: The branches behind it.
        row: Its row, from the top.
    """

    source: int
    target: int
    layer: int
    action: int
    label: str
    chosen: bool
    harm: str
    so_far: float
    total: float
    end: str
    parent: Branch | None
    value: float = 1.0
    children: list[Branch] = field(default_factory=list)
    row: float = 0.0

    @property
    def rank(self) -> tuple[bool, int, float, int]:
        """Sorts the best first."""
        danger = len(HARMS) - HARMS.index(self.harm) if self.harm else 0
        return (not self.chosen, danger, -self.total, self.action)


@dataclass(frozen=True)
class PlanLayout:
    """The edges to show.

    Attributes:
        branches: The edges, each before its children.
        root: Row of the root.
        rows: Number of rows.
    """

    branches: list[Branch]
    root: float
    rows: float


def lay_out(graph: nx.MultiDiGraph, weight: float, labels: Mapping[int, str]) -> PlanLayout:
    """Choose the edges of a planning graph to show, and place them.

    Args:
        graph: See `PlanningGraph.to_networkx`.
        weight: Discount per edge.
        labels: Action → label of its edge out of the root; other edges have the action's name.
    """
    branches = _select(graph, weight)
    _set_values(branches)
    first = [branch for branch in branches if branch.parent is None]
    for branch in first:
        branch.label = labels[branch.action]
    if sum(not branch.children for branch in branches) > _LABELLED:
        for branch in branches:
            if branch.layer and not branch.chosen:
                branch.label = ""
    rows = _place(first, 0.0)
    root = (first[0].row + first[-1].row) / 2 if first else 0.0
    return PlanLayout(branches, root, rows)


def short(name: str, longest: int = _LONGEST) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= longest else name[: longest - 1] + "…"


def _select(graph: nx.MultiDiGraph, weight: float) -> list[Branch]:
    """Choose edges: those along the best path, and layer by layer those out of the best states."""
    branches = _fan(graph, 0, None, weight)
    forked: set[int] = set()
    waiting = list(branches)
    while waiting:
        layer, waiting = sorted(waiting, key=lambda branch: branch.rank), []
        for branch in layer:
            fan = _fan(graph, branch.target, branch, weight)
            if not fan:
                continue
            along = any(child.chosen for child in fan)
            if branch.target in forked:
                branch.end = "elsewhere"
            elif not along and len(branches) + len(fan) > MAX_EDGES:
                branch.end = "collapsed"
            else:
                branch.end, branch.children = "fork", fan
                forked.add(branch.target)
                branches += fan
                waiting += fan
    return branches


def _fan(graph: nx.MultiDiGraph, node: int, parent: Branch | None, weight: float) -> list[Branch]:
    """Return the best edges out of a node, in the order of the actions."""
    layer = graph.nodes[node]["layer"]
    scale = weight**layer
    fan = []
    for _, target, action, data in graph.out_edges(node, keys=True, data=True):
        goal = graph.nodes[target]
        so_far = (parent.so_far if parent else 0.0) + scale * data["reward"]
        risk = f" ({percent(data['risk'])} risk)" if data["risky"] else ""
        harms = data["unsafe"], data["risky"], goal["safe_steps"] is not None
        branch = Branch(
            source=node,
            target=target,
            layer=layer,
            action=action,
            label=short(data["action"]) + risk,
            chosen=data["chosen"],
            harm=next((harm for harm, is_so in zip(HARMS, harms, strict=True) if is_so), ""),
            so_far=so_far,
            total=so_far + scale * weight * goal["value"],
            end="ended" if goal["ended"] else "leaf",
            parent=parent,
        )
        fan.append(branch)
    best = sorted(fan, key=lambda branch: branch.rank)[:MAX_FAN]
    return sorted(best, key=lambda branch: branch.action)


def _set_values(branches: Sequence[Branch]) -> None:
    safe = [b.total for b in branches if not b.harm]
    totals = sorted(filter(math.isfinite, safe)) or [0.0]
    # A single very low return must not make all others look alike.
    high, low = totals[-1], totals[len(totals) // 5]
    if low == high:
        low = totals[0]
    for branch in branches:
        if branch.harm or math.isnan(branch.total):
            branch.value = 0.0
        elif high > low:  # the shares are taken before the difference, which may overflow
            share = min(max(branch.total, low), high)
            branch.value = (share / 2 - low / 2) / (high / 2 - low / 2)


def _place(fan: Sequence[Branch], rows: float) -> float:
    """Set the rows of a state's edges below so many rows; return the number of rows then."""
    for branch in fan:
        if branch.children:
            rows = _place(branch.children, rows)
            branch.row = (branch.children[0].row + branch.children[-1].row) / 2
        else:
            rows += 1.0 if branch.label else _BARE
            branch.row = rows
    return rows + _APART
