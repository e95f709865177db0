"""The layout of a planning graph: as much of it as a person can read.

A graph is laid out as a tree from left to right: one column per layer, one row per leaf; an inner
node is centred on its children. Equal states of a layer are one node; its children are shown once,
behind the best edge that reaches it, and the other edges end there. Out of each state the best
edges are shown, and the rest are counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from serp._util.text import percent

if TYPE_CHECKING:
    import networkx as nx


MAX_ROWS: Final = 30
"""Rows to fill; only the best path with what is beside it may take more."""
HARMS: Final = ("unsafe", "risky", "doomed")
"""Flagged by the file; with a risk that is not accepted; leading to something unsafe later on,
whatever is done."""

_FIRST: Final = 12  # edges shown out of the root
_BESIDE: Final = 3  # at least so many out of each state of the best path
_FANS: Final = (12, 8, 5, 4, 3, 2, 1)  # edges shown out of other states: the most that fit
_LONGEST: Final = 26  # characters of a label
_APART: Final = 0.3  # rows between the branches of two states


@dataclass(eq=False)
class Branch:
    """An edge of the graph with its style and its place.

    Attributes:
        source, target: Nodes.
        layer: The source's layer.
        action: Position of the action.
        label: Text above it.
        chosen: Whether it is on the best path.
        harm: One of `HARMS`, or empty.
        so_far: Discounted sum of the rewards from the root along what is shown.
        total: The same with the best that follows.
        value: `total` between low (0) and the best (1); 0 for what is harmful or muted.
        end: What is at its end: `leaf`, `ended` (the task), `fork` (more branches), `elsewhere`
            (its state is shown elsewhere with what follows) or `collapsed` (what follows is not
            shown).
        parent: The branch before it; None at the root.
        muted: Whether it lies behind an edge that the planner does not take for its harm.
        children: The branches behind it.
        rest: Those behind it that are counted only, if any.
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
    muted: bool
    value: float = 1.0
    children: Sequence[Branch] = ()
    rest: Rest | None = None
    row: float = 0.0

    @property
    def rank(self) -> tuple[bool, int, float, int]:
        """Sorts the best first."""
        danger = len(HARMS) - HARMS.index(self.harm) if self.harm else 0
        return (not self.chosen, danger, -self.total, self.action)


@dataclass(eq=False)
class Rest:
    """Edges out of one state that are counted instead of shown.

    Attributes:
        count: Their number.
        best: The largest `Branch.total` of those without harm; None if there are none.
        harmful: Number of those with a harm.
        row: Their row.
    """

    count: int
    best: float | None
    harmful: int
    row: float = 0.0


@dataclass(frozen=True)
class PlanLayout:
    """The edges to show.

    Attributes:
        branches: The edges, each before its children.
        rest: Those out of the root that are counted only, if any.
        root: Row of the root.
        rows: Number of rows.
    """

    branches: list[Branch]
    rest: Rest | None
    root: float
    rows: float


def lay_out(
    graph: nx.MultiDiGraph, weight: float, labels: Mapping[int, str], rows: int = MAX_ROWS
) -> PlanLayout:
    """Choose the edges of a planning graph to show, and place them.

    Args:
        graph: See `PlanningGraph.to_networkx`.
        weight: Discount per edge.
        labels: Action → label of its edge out of the root; other edges have the action's name.
        rows: Rows to fill.
    """
    for keep in _FANS:
        branches, rest, fits = _select(graph, weight, keep, rows)
        if fits:
            break
    _set_values(branches)
    first = [branch for branch in branches if branch.parent is None]
    for branch in first:
        branch.label = labels[branch.action]
    below = _place(first, rest, 0.0)
    root = (first[0].row + first[-1].row) / 2 if first else 0.0
    return PlanLayout(branches, rest, root, below)


def short(name: str, longest: int = _LONGEST) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= longest else name[: longest - 1] + "…"


def _select(
    graph: nx.MultiDiGraph, weight: float, keep: int, most: int
) -> tuple[list[Branch], Rest | None, bool]:
    """Choose edges: the best path with what is beside it, then layer by layer the best others.

    Up to `keep` edges are shown out of a state that is not on the best path.

    Returns:
        The edges, those out of the root that are counted only, and whether all of that had a place
        in `most` rows.
    """
    branches, rest = _fan(graph, 0, None, weight, _FIRST)
    rows = len(branches) + bool(rest)
    forked: set[int] = set()

    def unfold(branch: Branch, kept: int, most: float) -> bool:
        nonlocal rows
        fan, more = _fan(graph, branch.target, branch, weight, kept)
        taken = rows + len(fan) + bool(more) - 1
        if taken > most:
            return False
        branch.end, branch.children, branch.rest, rows = "fork", fan, more, taken
        forked.add(branch.target)
        branches.extend(fan)
        return True

    fits = True
    layer = branches[:]
    path = [branch for branch in branches if branch.chosen]
    for branch in path:
        if graph.out_degree(branch.target):
            unfold(branch, max(keep, _BESIDE), math.inf)
            path += [child for child in branch.children if child.chosen]
    while layer:
        for branch in sorted(layer, key=lambda branch: branch.rank):
            if branch.children or not graph.out_degree(branch.target):
                continue
            if branch.target in forked:
                branch.end = "elsewhere"
            elif branch.harm in ("unsafe", "risky") or branch.muted:
                branch.end = "collapsed"
            elif not unfold(branch, keep, most):
                branch.end, fits = "collapsed", False
        layer = [child for branch in layer for child in branch.children]
    return branches, rest, fits


def _fan(
    graph: nx.MultiDiGraph, node: int, parent: Branch | None, weight: float, keep: int
) -> tuple[list[Branch], Rest | None]:
    """Return the best edges out of a node, in the order of the actions, and the rest of them."""
    layer = graph.nodes[node]["layer"]
    scale = weight**layer
    muted = parent is not None and (parent.muted or parent.harm in ("unsafe", "risky"))
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
            muted=muted,
        )
        fan.append(branch)
    if len(fan) <= keep + 1:  # a count would take the row of the one that it counts
        return sorted(fan, key=lambda branch: branch.action), None
    fan.sort(key=lambda branch: branch.rank)
    counted = fan[keep:]
    safe = [branch.total for branch in counted if not branch.harm]
    rest = Rest(len(counted), max(safe, default=None), len(counted) - len(safe))
    return sorted(fan[:keep], key=lambda branch: branch.action), rest


def _set_values(branches: Sequence[Branch]) -> None:
    safe = [b.total for b in branches if not (b.harm or b.muted)]
    totals = sorted(filter(math.isfinite, safe)) or [0.0]
    # A single very low return must not make all others look alike.
    high, low = totals[-1], totals[len(totals) // 5]
    if low == high:
        low = totals[0]
    alike = math.isclose(high, low, rel_tol=1e-9)
    for branch in branches:
        if branch.harm or branch.muted or math.isnan(branch.total):
            branch.value = 0.0
        elif not alike:  # the shares are taken before the difference, which may overflow
            share = min(max(branch.total, low), high)
            branch.value = (share / 2 - low / 2) / (high / 2 - low / 2)


def _place(fan: Sequence[Branch], rest: Rest | None, rows: float) -> float:
    """Set the rows of a state's edges below so many rows; return the number of rows then."""
    for branch in fan:
        if branch.children:
            rows = _place(branch.children, branch.rest, rows)
            branch.row = (branch.children[0].row + branch.children[-1].row) / 2
        else:
            rows += 1.0
            branch.row = rows
    if rest is not None:
        rows += 1.0
        rest.row = rows
    return rows + _APART
