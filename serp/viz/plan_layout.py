"""The layout of a planning graph for `serp.viz.plan_drawing`.

A graph is laid out as a tree from left to right: one column per layer, one row per leaf; an inner
node is centred on its children. Equal states of a layer are one node; its children are shown once,
behind the best edge that reaches it, and the other edges end there.
"""

from __future__ import annotations

import heapq
import itertools
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

_LONGEST = 26  # characters of a label
_DENSITIES = ((72, 0.175, 7.0), (130, 0.13, 6.0))  # up to so many rows: inches, size of labels
_BARE = 0.09  # inches of a row without a label
_APART = 0.05  # inches between the branches of two states
_POINT = 1 / 72  # inches
_CHARACTER = 0.63  # width of a character by its height
_TURN = 0.45  # inches in which an edge turns from its source to the row of its target


@dataclass(eq=False)
class Branch:
    """An edge of the graph with its style and its position in inches.

    Attributes:
        source, target: Nodes.
        layer: The source's layer.
        action: Position of the action.
        label: Text above it; may be empty.
        chosen: Whether it is on the best path.
        unsafe: Whether the file flags it.
        risky: Whether its risk is not accepted.
        doomed: Whether something unsafe follows later on, whatever is done.
        total: Discounted sum of rewards of the best path through it, from the root.
        promise: `total` between low (0) and the best (1); 0 for what is `harmful`.
        end: What is at its end: `leaf`, `ended` (the task), `fork` (more branches), `elsewhere`
            (its state is shown elsewhere with what follows) or `collapsed` (what follows is not
            shown).
        parent: The branch before it; None at the root.
        x, y: Where it ends, from the upper left corner of the graph.
        turned: Where it has reached its row.
    """

    source: int
    target: int
    layer: int
    action: int
    label: str
    chosen: bool
    unsafe: bool
    risky: bool
    doomed: bool
    total: float
    promise: float = 1.0
    end: str = "leaf"
    parent: Branch | None = None
    children: list[Branch] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    turned: float = 0.0

    @property
    def rank(self) -> tuple[bool, bool, bool, bool, float, int]:
        """Sorts the best first."""
        safety = (self.unsafe, self.risky, self.doomed)
        return (not self.chosen, *safety, -self.total, self.action)

    @property
    def harmful(self) -> bool:
        """Whether something unsafe may happen on it, or later on whatever is done."""
        return self.unsafe or self.risky or self.doomed


@dataclass(frozen=True)
class PlanLayout:
    """The edges to show, with positions in inches.

    Attributes:
        branches: The edges, each before its children.
        root: Vertical position of the root.
        width, height: Size of the graph.
        size: Font size of the labels, points.
    """

    branches: list[Branch]
    root: float
    width: float
    height: float
    size: float


def lay_out(graph: nx.MultiDiGraph, weight: float, labels: Mapping[int, str]) -> PlanLayout:
    """Choose the edges of a planning graph to show, and place them.

    Args:
        graph: See `PlanningGraph.to_networkx`.
        weight: Discount per edge.
        labels: Action → label of its edge out of the root; other edges have the action's name.
    """
    first, branches = _select(graph, _leaving(graph, weight))
    _set_promise(branches)
    for branch in first:
        branch.label = labels[branch.action]
    leaves = sum(not branch.children for branch in branches)
    row, size = next(((r, s) for most, r, s in _DENSITIES if leaves <= most), (_BARE, 7.0))
    if row == _BARE:
        for branch in branches:
            if branch.layer and not branch.chosen:
                branch.label = ""
        row = _DENSITIES[0][1]
    root = _place_rows(first, branches, row)
    width = _place_columns(branches, size)
    height = max((branch.y for branch in branches), default=0.0)
    return PlanLayout(branches, root, width, height, size)


def short(name: str, longest: int = _LONGEST) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= longest else name[: longest - 1] + "…"


def _leaving(graph: nx.MultiDiGraph, weight: float) -> dict[int, list[Branch]]:
    """Return the edges out of every node."""
    # Nodes are numbered layer by layer, so that a source is reached before it is left.
    reached = dict.fromkeys(graph, float("-inf"))
    reached[0] = 0.0
    leaving: dict[int, list[Branch]] = {}
    for source in sorted(graph):
        layer = graph.nodes[source]["layer"]
        scale = weight**layer
        for _, target, action, data in graph.out_edges(source, keys=True, data=True):
            so_far = reached[source] + scale * data["reward"]
            reached[target] = max(reached[target], so_far)
            goal = graph.nodes[target]
            branch = Branch(
                source=source,
                target=target,
                layer=layer,
                action=action,
                label=short(data["action"])
                + (f" ({percent(data['risk'])} risk)" if data["risky"] else ""),
                chosen=data["chosen"],
                unsafe=data["unsafe"],
                risky=data["risky"],
                doomed=goal["safe_steps"] is not None and not (data["unsafe"] or data["risky"]),
                total=so_far + scale * weight * goal["value"],
                end="ended" if goal["ended"] else "leaf",
            )
            leaving.setdefault(source, []).append(branch)
    return leaving


def _select(
    graph: nx.MultiDiGraph, leaving: Mapping[int, list[Branch]]
) -> tuple[list[Branch], list[Branch]]:
    """Choose edges: those along the best path, then layer by layer those out of the best states.

    Returns:
        The branches out of the root, and all branches.
    """
    branches: list[Branch] = []
    forked: set[int] = set()

    def fork(node: int, parent: Branch | None) -> list[Branch]:
        fan = sorted(leaving.get(node, ()), key=lambda branch: branch.rank)[:MAX_FAN]
        along = bool(fan) and fan[0].chosen
        if parent is not None and not along and len(branches) + len(fan) > MAX_EDGES:
            parent.end = "collapsed"
            return []
        forked.add(node)
        fan.sort(key=lambda branch: branch.action)
        branches.extend(fan)
        for branch in fan:
            branch.parent = parent
            heapq.heappush(
                waiting, (not branch.chosen, branch.layer, branch.rank, next(ties), branch)
            )
        return fan

    ties = itertools.count()
    waiting: list[tuple[bool, int, tuple[object, ...], int, Branch]] = []
    first = fork(0, None)
    while waiting:
        branch = heapq.heappop(waiting)[-1]
        if branch.target not in leaving:
            continue
        if branch.target in forked:
            branch.end = "elsewhere"
            continue
        branch.children = fork(branch.target, branch)
        if branch.children:
            branch.end = "fork"
    return first, branches


def _set_promise(branches: Sequence[Branch]) -> None:
    safe = [b.total for b in branches if not b.harmful]
    totals = sorted(filter(math.isfinite, safe)) or [0.0]
    # A single very low return must not make all others look alike.
    high, low = totals[-1], totals[len(totals) // 5]
    if low == high:
        low = totals[0]
    for branch in branches:
        if branch.harmful or math.isnan(branch.total):
            branch.promise = 0.0
        elif high > low:  # the shares are taken before the difference, which may overflow
            share = min(max(branch.total, low), high)
            branch.promise = (share / 2 - low / 2) / (high / 2 - low / 2)


def _place_rows(first: Sequence[Branch], branches: Sequence[Branch], row: float) -> float:
    """Set the height of every branch; return that of the root."""
    below = 0.0
    last: Branch | None = None
    waiting = list(reversed(first))
    while waiting:
        branch = waiting.pop()
        waiting += reversed(branch.children)
        if not branch.children:
            below += row if branch.label else _BARE
            below += _APART if last is not None and last.parent is not branch.parent else 0.0
            branch.y, last = below, branch
    for branch in reversed(branches):
        if branch.children:
            branch.y = (branch.children[0].y + branch.children[-1].y) / 2
    return (first[0].y + first[-1].y) / 2 if first else 0.0


def _place_columns(branches: Sequence[Branch], size: float) -> float:
    """Set where every branch turns and ends; return where the last one ends."""
    layers: dict[int, list[Branch]] = {}
    for branch in branches:
        layers.setdefault(branch.layer, []).append(branch)
    x = 0.0
    for layer in sorted(layers):
        longest = max(len(branch.label) for branch in layers[layer])
        turned = x + _TURN
        x = turned + 0.25 + _CHARACTER * size * _POINT * longest
        for branch in layers[layer]:
            branch.turned, branch.x = turned, x
    return x
