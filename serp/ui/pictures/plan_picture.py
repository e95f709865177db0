"""The picture of a decision: the planning graph as SVG, with text that can be searched.

The graph is laid out as a tree from left to right: one column per layer, one row per leaf. The best
edge out of a node goes straight on, so that the best path is the top row; the others follow below.
Equal states of a layer are one node; its children are shown once, behind the best edge that reaches
it. Of a large graph the best part is drawn.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import networkx as nx

from serp._util.figures import colour, style_sheet
from serp._util.text import percent, readable
from serp.agent.sentences import kind_of_return, special_about
from serp.planning.replanner import MonitorReplanner, Plan
from serp.ui.output import changes_between

MAX_ROWS: Final = 30
"""Rows to fill; only the best path with its siblings may take more."""
DASHES: Final = {"unsafe": "6 3", "risk not accepted": "6 2 1 2", "unsafe later": "1.5 3"}
"""Harm → its dashes: flagged by the file; a risk that is not accepted; every continuation leads to
something unsafe."""
_ENDS: Final = {
    "ended": ("■", "the task ends"),
    "elsewhere": ("=", "same state as another one here"),
    "collapsed": ("…", "goes on, not drawn"),
}
"""End of a branch → its sign and its meaning."""
_CHARACTER = 7.4  # average width of letters, pixels
_TURN, _MARGIN, _LINE = 34.0, 14.0, 19.0


@dataclass(eq=False)
class Branch:
    """An edge of the graph that is drawn.

    Attributes:
        source, target, layer, action: Its nodes, the source's layer, the position of its action.
        label: Text above it.
        chosen: Whether it is on the best path.
        harm: A key of `DASHES`, or empty.
        so_far: Discounted sum of the rewards from the root.
        total: The same with the best that follows.
        end: `leaf`, `fork` (more branches), `ended` (the task), `elsewhere` (its state is shown
            elsewhere with what follows) or `collapsed` (what follows is not shown).
        children: The branches behind it.
        row: Its row.
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
    children: Sequence[Branch] = ()
    row: float = 0.0

    @property
    def rank(self) -> tuple[bool, int, float, int]:
        """Sorts the best first."""
        danger = len(DASHES) - list(DASHES).index(self.harm) if self.harm else 0
        return (not self.chosen, danger, -self.total, self.action)

    def behind(self) -> Iterator[tuple[Branch, Branch]]:
        """Yield all branches behind it, each with its parent."""
        for child in self.children:
            yield self, child
            yield from child.behind()


def lay_out(graph: nx.MultiDiGraph, weight: float, rows: int = MAX_ROWS) -> Branch:
    """Choose the edges of a planning graph to show, and place them; return the root, no edge.

    `weight` is the discount per edge; `rows` are to be filled.
    """
    for keep in (12, 8, 5, 4, 3, 2, 1):
        root, fits = _select(graph, weight, keep, rows)
        if fits:
            break
    _place(root, 0.0)
    return root


def short(name: str) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= 26 else name[:25] + "…"


def _select(graph: nx.MultiDiGraph, weight: float, keep: int, most: int) -> tuple[Branch, bool]:
    """Choose edges, layer by layer: those out of the best path, and the best others.

    Up to `keep` edges are shown out of a state that is not on the best path. Returns the root and
    whether all of that fitted into `most` rows.
    """
    root = Branch(0, 0, -1, -1, "", True, "", 0.0, 0.0, "fork")
    rows, fits, forked, layer = 1, True, set[int](), [root]
    while layer:
        for branch in sorted(layer, key=lambda branch: branch.rank):
            if not graph.out_degree(branch.target):
                continue
            if branch.target in forked:
                branch.end = "elsewhere"
                continue
            if branch.harm not in ("", "unsafe later") and not branch.chosen:
                branch.end = "collapsed"
                continue
            kept = 12 if branch is root else max(keep, 3) if branch.chosen else keep
            fan = _fan(graph, branch, weight, kept)
            if branch.chosen or rows + len(fan) - 1 <= most:
                branch.end, branch.children, rows = "fork", fan, rows + len(fan) - 1
                forked.add(branch.target)
            else:
                branch.end, fits = "collapsed", False
        layer = [child for branch in layer for child in branch.children]
    return root, fits and rows <= most


def _fan(graph: nx.MultiDiGraph, parent: Branch, weight: float, keep: int) -> list[Branch]:
    """Return the best edges behind a branch, the best first."""
    layer = parent.layer + 1
    scale, fan = weight**layer, []
    for _, target, action, data in graph.out_edges(parent.target, keys=True, data=True):
        goal = graph.nodes[target]
        so_far = parent.so_far + scale * data["reward"]
        harms = data["unsafe"], data["risky"], goal["safe_steps"] is not None
        harm = next((harm for harm, holds in zip(DASHES, harms, strict=True) if holds), "")
        about = f"{percent(data['risk'])} risk" if data["risky"] else harm
        total = so_far + scale * weight * goal["value"]
        worth = "" if layer else f": {readable(total)}"
        fan.append(
            Branch(
                source=parent.target,
                target=target,
                layer=layer,
                action=action,
                label=short(data["action"]) + worth + (f" ({about})" if about else ""),
                chosen=data["chosen"],
                harm=harm,
                so_far=so_far,
                total=total,
                end="ended" if goal["ended"] else "leaf",
            )
        )
    return sorted(fan, key=lambda branch: branch.rank)[:keep]


def _place(parent: Branch, rows: float) -> float:
    """Set the rows of a branch and of what is behind it, below so many rows; return the rows."""
    for branch in parent.children:
        rows = _place(branch, rows)
    if not parent.children:
        parent.row = rows + 1.0
        return parent.row
    parent.row = parent.children[0].row
    return rows + 0.3


class _GraphDrawing:
    """The planning graph of a decision as SVG elements: `lines`, `width` and `height` in pixels."""

    def __init__(self, plan: Plan, planner: MonitorReplanner) -> None:
        self._plan, self._planner = plan, planner
        root = lay_out(plan.graph, planner.settings.discount)
        branches = [*root.behind()]
        self.edges = f"{len(branches):,} of {plan.graph.number_of_edges():,} edges are drawn"
        self._columns = [_MARGIN]
        for layer in range(1 + max((branch.layer for _, branch in branches), default=-1)):
            longest = max(len(b.label) * (1.25 if b.chosen else 1)
                          for _, b in branches if b.layer == layer)  # fmt: skip
            self._columns.append(self._columns[-1] + _TURN + 24 + _CHARACTER * longest)
        self.width, style = self._columns[-1] + _MARGIN, f'style="fill:{colour("ink")}"'
        self.height = _y(max([1.0, *(branch.row for _, branch in branches)])) + 14
        now = f'cx="{_MARGIN:.1f}" cy="{_y(root.row):.1f}" r="5.5" {style}'
        # The best ones last, so that they lie on top.
        branches.sort(key=lambda pair: pair[1].rank, reverse=True)
        self.lines = [line for pair in branches for line in self._branch(*pair)]
        self.lines.append(f"<circle {now}><title>now</title></circle>")
        if path := [branch for _, branch in branches if branch.chosen]:
            last = max(path, key=lambda branch: branch.layer)
            x, shade = self._columns[last.layer + 1] + 11, "good" if plan.safe else "bad"
            text = f"return {readable(plan.reward)}"
            self.width = max(self.width, x + _CHARACTER * len(text) + _MARGIN)
            self.lines.append(_text(x, _y(last.row) + 4.5, text, shade, bold=True))

    def _branch(self, parent: Branch, branch: Branch) -> Iterator[str]:
        x, end = self._columns[branch.layer], self._columns[branch.layer + 1]
        y0, y, middle, turned = _y(parent.row), _y(branch.row), x + _TURN / 2, x + _TURN
        shade, thick = "bad" if branch.harm else "good", 3.4 if branch.chosen else 1.2
        path = f"M{x:.1f} {y0:.1f}C{middle:.1f} {y0:.1f} {middle:.1f} {y:.1f} {turned:.1f} {y:.1f}"
        dashes = f'stroke-dasharray="{DASHES[branch.harm]}" ' if branch.harm else ""
        style = f'fill="none" stroke-width="{thick:.1f}" {dashes}style="stroke:{colour(shade)}"'
        ink = shade if branch.harm or branch.chosen else "ink" if branch.layer == 0 else "faint"
        yield f"<g><title>{escape(self._tooltip(branch))}</title>"
        yield f'<path d="{path}H{end - 6:.1f}" {style}/>'
        sign = _ENDS[branch.end][0] if branch.end in _ENDS else "•"
        yield _text(end - 5, y + 4.5, sign, "ink")
        large = branch.chosen and branch.layer == 0
        yield _text(turned + 4, y - 5.5, branch.label, ink, bold=branch.chosen, large=large)
        yield "</g>"

    def _tooltip(self, branch: Branch) -> str:
        """Return what an edge is worth, and what it changes."""
        edge = self._plan.graph.edges[branch.source, branch.target, branch.action]
        nodes = self._plan.graph.nodes
        before, after = nodes[branch.source]["state"], nodes[branch.target]["state"]
        changes = changes_between(self._planner.model, before, after)
        worth = f"reward {readable(edge['reward'])}, return {readable(branch.total)}"
        about = branch.harm, _ENDS.get(branch.end, ("", ""))[1]
        return "\n".join([f"{edge['action']}: {worth}", *filter(None, about), *changes[:24]])


def plan_svg(plan: Plan, planner: MonitorReplanner) -> str:
    """Return the planning graph of a decision as an `svg` element for a page.

    Its colours are the page's CSS variables of the names in `serp._util.figures.PALETTE`, or else
    the light ones. Names of the file are escaped.
    """
    drawing = _GraphDrawing(plan, planner)
    lines = [f"<desc>{drawing.edges}</desc>", *drawing.lines]
    return _svg(drawing.width, drawing.height, lines, "Planning graph")


def plan_picture(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> bytes:
    """Return the picture of a decision as an SVG file; equal decisions give equal bytes."""
    drawing = _GraphDrawing(plan, planner)
    width, height = max(560.0, drawing.width), drawing.height + _LINE
    signs = "; ".join(f"{sign} {meaning}" for sign, meaning in _ENDS.values())
    kind = f"The number beside a first action is its {kind_of_return(plan.forecast.bound.partial)}."
    sentences = " ".join([kind, *special_about(plan.forecast), f"{drawing.edges}. {signs}."])
    foot = textwrap.wrap(sentences, int((width - 2 * _MARGIN) / _CHARACTER))
    page = [
        style_sheet(),
        f"<title>{escape(title)}</title>",
        f'<rect width="100%" height="100%" style="fill:{colour("surface")}"/>',
        _text(_MARGIN, _LINE, title, "ink", bold=True),
        f'<g transform="translate(0 {_LINE})">',
        *drawing.lines,
        "</g>",
        *(_text(_MARGIN, height + k * _LINE, text) for k, text in enumerate(foot, 1)),
    ]
    return (_svg(width, height + _LINE * (len(foot) + 1), page, title) + "\n").encode()


def _svg(width: float, height: float, lines: list[str], label: str) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(label)}" '
        f'font-family="system-ui, sans-serif" font-size="13">'
    )
    return "\n".join([head, *lines, "</svg>"])


def _y(row: float) -> float:
    return _MARGIN + 23.0 * row


def _text(
    x: float, y: float, text: str, shade: str = "faint", *, bold: bool = False, large: bool = False
) -> str:
    font = ' font-weight="600"' * bold + ' font-size="16"' * large
    return f'<text x="{x:.1f}" y="{y:.1f}" style="fill:{colour(shade)}"{font}>{escape(text)}</text>'
