"""The picture of a decision: the planning graph as SVG, with text that can be searched.

The graph is laid out as a tree from left to right: one column per layer, one row per leaf; an inner
node is centred on its children. Equal states of a layer are one node; its children are shown once,
behind the best edge that reaches it. Of a large graph the best part is drawn, the rest is counted.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Final

from serp._util.figures import colour, style_sheet
from serp._util.text import percent, readable
from serp.agent.sentences import kind_of_return, special_about

if TYPE_CHECKING:
    import networkx as nx

    from serp.planning.replanner import MonitorReplanner, Plan


MAX_ROWS: Final = 30
"""Rows to fill; only the best path with its siblings may take more."""
DASHES: Final = {"unsafe": "6 3", "risky": "6 2 1 2", "dead end": "1.5 3"}
"""Harm → its dashes: flagged by the file; a risk that is not accepted; every continuation leads to
something unsafe."""
_HARMS: Final = {
    "unsafe": "unsafe",
    "risky": "risk not accepted",
    "dead end": "unsafe later, whatever follows",
}
_ENDS: Final = {
    "ended": "the task ends",
    "elsewhere": "same state as another one here",
    "collapsed": "goes on, not drawn",
}
_CHARACTER = 7.4  # average width of letters, pixels
_TURN, _MARGIN = 34.0, 14.0
_LINE, _EDGE, _SAMPLE = 19.0, 16.0, 40.0


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
        end: `leaf`, `ended` (the task), `fork` (more branches), `elsewhere` (its state is shown
            elsewhere with what follows) or `collapsed` (what follows is not shown).
        parent: The branch before it; None at the root.
        muted: Whether it lies behind an edge that is unsafe or too risky.
        children: The branches behind it.
        rest: What the edges behind it that are not drawn are worth; empty where all are drawn.
        row, rest_row: The rows of the branch and of that text.
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
    children: Sequence[Branch] = ()
    rest: str = ""
    row: float = 0.0
    rest_row: float = 0.0

    @property
    def rank(self) -> tuple[bool, int, float, int]:
        """Sorts the best first."""
        danger = len(DASHES) - list(DASHES).index(self.harm) if self.harm else 0
        return (not self.chosen, danger, -self.total, self.action)


@dataclass
class PlanLayout:
    """The branches to draw, each before its children, behind a `root` that is no edge."""

    root: Branch
    branches: list[Branch] = field(default_factory=list)
    rows: float = 0.0


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
    for keep in (12, 8, 5, 4, 3, 2, 1):
        layout, fits = _select(graph, weight, keep, rows)
        if fits:
            break
    for branch in layout.root.children:
        branch.label = labels[branch.action]
    layout.rows = _place(layout.root, 0.0)
    return layout


def short(name: str) -> str:
    """Return a name, cut where it is too long for a label."""
    return name if len(name) <= 26 else name[:25] + "…"


def _select(graph: nx.MultiDiGraph, weight: float, keep: int, most: int) -> tuple[PlanLayout, bool]:
    """Choose edges: the best path with its siblings, then layer by layer the best others.

    Up to `keep` edges are shown out of a state that is not on the best path. Returns the layout and
    whether all of that fitted into `most` rows.
    """
    root = Branch(0, 0, -1, -1, "", False, "", 0.0, 0.0, "fork", None, False)
    root.children, root.rest = _fan(graph, root, weight, 12)
    layout = PlanLayout(root, list(root.children))
    rows = len(root.children) + bool(root.rest)
    forked: set[int] = set()

    def unfold(branch: Branch, kept: int, most: float) -> bool:
        nonlocal rows
        fan, rest = _fan(graph, branch, weight, kept)
        taken = rows + len(fan) + bool(rest) - 1
        if taken > most:
            return False
        branch.end, branch.children, branch.rest, rows = "fork", fan, rest, taken
        forked.add(branch.target)
        layout.branches.extend(fan)
        return True

    fits = True
    layer = layout.branches[:]
    path = [branch for branch in layer if branch.chosen]
    for branch in path:
        if graph.out_degree(branch.target):
            unfold(branch, max(keep, 3), math.inf)
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
    return layout, fits


def _fan(
    graph: nx.MultiDiGraph, parent: Branch, weight: float, keep: int
) -> tuple[list[Branch], str]:
    """Return the best edges behind a branch, in the file's order, and a text on the others."""
    layer = parent.layer + 1
    scale = weight**layer
    fan = []
    for _, target, action, data in graph.out_edges(parent.target, keys=True, data=True):
        goal = graph.nodes[target]
        so_far = parent.so_far + scale * data["reward"]
        risk = f" ({percent(data['risk'])} risk)" if data["risky"] else ""
        harms = data["unsafe"], data["risky"], goal["safe_steps"] is not None
        fan.append(
            Branch(
                source=parent.target,
                target=target,
                layer=layer,
                action=action,
                label=short(data["action"]) + risk,
                chosen=data["chosen"],
                harm=next((harm for harm, holds in zip(DASHES, harms, strict=True) if holds), ""),
                so_far=so_far,
                total=so_far + scale * weight * goal["value"],
                end="ended" if goal["ended"] else "leaf",
                parent=parent,
                muted=parent.muted or parent.harm in ("unsafe", "risky"),
            )
        )
    rest = ""
    if len(fan) > keep + 1:  # a text would take the row of the one edge that it counts
        fan.sort(key=lambda branch: branch.rank)
        safe = [branch.total for branch in fan[keep:] if not branch.harm]
        worth = f"none better than {readable(max(safe))}" if safe else "all harmful"
        rest, fan = f"… {len(fan) - keep:,} more, {worth}", fan[:keep]
    return sorted(fan, key=lambda branch: branch.action), rest


def _place(parent: Branch, rows: float) -> float:
    """Set the rows of what is behind a branch, below so many rows; return the rows then."""
    for branch in parent.children:
        rows = _place(branch, rows) if branch.children else rows + 1.0
        if not branch.children:
            branch.row = rows
    if parent.children:
        parent.row = (parent.children[0].row + parent.children[-1].row) / 2
    if parent.rest:
        rows += 1.0
        parent.rest_row = rows
    return rows + 0.3


class _Drawing:
    """The planning graph of a decision as SVG elements: `lines`, `width` and `height` in pixels."""

    def __init__(self, plan: Plan, planner: MonitorReplanner, rows: int) -> None:
        self._plan, self._planner = plan, planner
        labels = {
            k: f"{short(action.name)}: {readable(float(plan.forecast.value[k]))}"
            for k, action in enumerate(planner.model.actions)
            if plan.forecast.applicable[k]
        }
        settings = planner.settings
        self.layout = lay_out(plan.graph, settings.discount, labels, rows)
        branches = self.layout.branches
        self._columns = [_MARGIN]
        for layer in range(1 + max((branch.layer for branch in branches), default=-1)):
            longest = max(len(branch.label) for branch in branches if branch.layer == layer)
            self._columns.append(self._columns[-1] + _TURN + 16 + _CHARACTER * longest)
        self._right = self._columns[-1]
        self.lines = list(self._lines())
        self.width = self._right + _MARGIN
        self.height = _y(max(1.0, self.layout.rows)) + 14

    def _lines(self) -> Iterator[str]:
        root, branches = self.layout.root, self.layout.branches
        yield from self._rest(root)
        # The best ones last, so that they lie on top.
        for branch in sorted(branches, key=lambda branch: branch.rank, reverse=True):
            yield from self._branch(branch)
            yield from self._rest(branch)
        yield (
            f'<circle cx="{_MARGIN:.1f}" cy="{_y(root.row):.1f}" r="5.5" '
            f'style="fill:{colour("ink")}"><title>now</title></circle>'
        )
        if path := [branch for branch in branches if branch.chosen]:
            last = max(path, key=lambda branch: branch.layer)
            x, shade = self._columns[last.layer + 1] + 11, "good" if self._plan.safe else "bad"
            text = f"return {readable(self._plan.reward)}"
            yield self._text(x, _y(last.row) + 4.5, text, shade, bold=True)

    def _branch(self, branch: Branch) -> Iterator[str]:
        shade = "bad" if branch.harm else "faint" if branch.muted else "good"
        thick = 3.4 if branch.chosen else 1.2
        assert branch.parent is not None
        yield f"<g><title>{escape(self._tooltip(branch))}</title>"
        end = f"H{self._columns[branch.layer + 1]:.1f}"
        yield self._curve(branch.parent.row, branch.row, branch.layer, end,
                          _stroke(shade, thick, dashes=DASHES.get(branch.harm, "")))  # fmt: skip
        yield _mark(branch, self._columns[branch.layer + 1], _y(branch.row), shade)
        ink = shade if branch.harm or branch.chosen else "ink" if branch.layer == 0 else "faint"
        x = self._columns[branch.layer] + _TURN + 4
        yield self._text(x, _y(branch.row) - 5.5, branch.label, ink, bold=branch.chosen)
        yield "</g>"

    def _rest(self, parent: Branch) -> Iterator[str]:
        if parent.rest:
            layer = parent.layer + 1
            style = _stroke("faint", 0.8, 0.6, "1 3")
            yield self._curve(parent.row, parent.rest_row, layer, "", style)
            x, y = self._columns[layer] + _TURN + 4, _y(parent.rest_row) + 4
            yield self._text(x, y, parent.rest, "faint")

    def _curve(self, start: float, row: float, layer: int, end: str, style: str) -> str:
        x, y0, y1 = self._columns[layer], _y(start), _y(row)
        middle, turned = x + _TURN / 2, x + _TURN
        curve = f"C{middle:.1f} {y0:.1f} {middle:.1f} {y1:.1f} {turned:.1f} {y1:.1f}"
        path = f"M{x:.1f} {y0:.1f}{curve}"
        return f'<path d="{path}{end}" {style}/>'

    def _text(self, x: float, y: float, text: str, shade: str, *, bold: bool = False) -> str:
        self._right = max(self._right, x + _CHARACTER * len(text))
        return _text(x, y, text, shade, ' font-weight="600"' if bold else "")

    def _tooltip(self, branch: Branch) -> str:
        """Return what an edge is worth, and what it changes."""
        edge = self._plan.graph.edges[branch.source, branch.target, branch.action]
        nodes = self._plan.graph.nodes
        before, after = nodes[branch.source]["state"], nodes[branch.target]["state"]
        changes = [
            f"{fluent.name} = {readable(new if fluent.numeric else bool(new))}"
            for fluent, old, new in zip(self._planner.model.fluents, before, after, strict=True)
            if old != new
        ]
        worth = f"reward {readable(edge['reward'])}, return {readable(branch.total)}"
        about = [_HARMS.get(branch.harm, ""), _ENDS.get(branch.end, "")]
        return "\n".join([f"{edge['action']}: {worth}", *filter(None, about), *changes[:24]])


def plan_svg(plan: Plan, planner: MonitorReplanner, *, rows: int = MAX_ROWS) -> str:
    """Return the planning graph of a decision as an `svg` element for a page.

    Its colours are the page's CSS variables of the names in `serp._util.figures.PALETTE`, or else
    the light ones. Names of the file are escaped.
    """
    drawing = _Drawing(plan, planner, rows)
    drawn, edges = len(drawing.layout.branches), plan.graph.number_of_edges()
    about = f"<desc>{drawn:,} of {edges:,} edges are drawn</desc>"
    return _svg(drawing.width, drawing.height, [about, *drawing.lines], "Planning graph")


def plan_picture(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> bytes:
    """Return the picture of a decision as an SVG file; equal decisions give equal bytes."""
    drawing = _Drawing(plan, planner, MAX_ROWS)
    width = max(560.0, drawing.width)
    wide = int(width / _CHARACTER)
    y = _LINE
    lines = [_text(0, y, title, "ink", ' font-weight="600" font-size="17"')]
    for text in _head(plan, planner, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    y += _LINE / 2
    lines += [f'<g transform="translate(0 {y:.1f})">', *drawing.lines, "</g>"]
    y += drawing.height
    x = 0.0
    for sample, text in _legend(drawing.layout.branches, plan):
        if x and x + _SAMPLE + _CHARACTER * len(text) > width:
            x, y = 0.0, y + _LINE
        lines.append(f'<g transform="translate({x:.1f} {y:.1f})">{sample}</g>')
        lines.append(_text(x + _SAMPLE, y + 4.5, text))
        x += _SAMPLE + _CHARACTER * (len(text) + 2)
    y += _LINE / 2
    for text in _foot(len(drawing.layout.branches), plan, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    page = [
        style_sheet(),
        f"<title>{escape(title)}</title>",
        f'<rect width="100%" height="100%" style="fill:{colour("surface")}"/>',
        f'<g transform="translate({_EDGE:.0f} {_EDGE / 2:.0f})">',
        *lines,
        "</g>",
    ]
    return (_svg(width + 2 * _EDGE, y + 2 * _EDGE, page, title) + "\n").encode()


def _svg(width: float, height: float, lines: list[str], label: str) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(label)}" '
        f'font-family="system-ui, sans-serif" font-size="13">'
    )
    return "\n".join([head, *lines, "</svg>"])


def _y(row: float) -> float:
    return _MARGIN + 23.0 * row


def _text(x: float, y: float, text: str, shade: str = "faint", more: str = "") -> str:
    style = f'style="fill:{colour(shade)}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{more} {style}>{escape(text)}</text>'


def _stroke(shade: str, thick: float, opacity: float = 1.0, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return (
        f'fill="none" stroke-width="{thick:.1f}" opacity="{opacity:.2f}"{dashed} '
        f'style="stroke:{colour(shade)}"'
    )


def _mark(branch: Branch, x: float, y: float, shade: str) -> str:
    """Return what is drawn at the end of an edge."""
    if branch.harm == "unsafe":
        cross = f"M{x - 4.5:.1f} {y - 4.5:.1f}l9 9m0 -9l-9 9"
        return f'<path d="{cross}" {_stroke("bad", 2.4)}/>'
    return _end_mark(branch.end, x, y) or (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{4.5 if branch.chosen else 2.2}" '
        f'style="fill:{colour(shade if branch.chosen else "faint")}"/>'
    )


def _end_mark(end: str, x: float, y: float) -> str:
    if end == "ended":
        style = f'style="fill:{colour("ink")}"'
        return f'<rect x="{x - 3.5:.1f}" y="{y - 3.5:.1f}" width="7" height="7" {style}/>'
    if end == "collapsed":
        style = f'style="fill:{colour("faint")}"'
        return f'<path d="M{x - 3:.1f} {y - 4.5:.1f}l8 4.5l-8 4.5z" {style}/>'
    if end == "elsewhere":
        style = f'style="fill:{colour("surface")};stroke:{colour("faint")}"'
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" {style}/>'
    return ""


def _head(plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    state, fluents = plan.graph.nodes[0]["state"], planner.model.fluents
    numbers = [f"{f.name} = {readable(float(state[f.index]))}" for f in fluents if f.numeric]
    facts = [f.name for f in fluents if not f.numeric and state[f.index]]
    lines = _wrapped("State: ", ", ".join(numbers + facts), wide, 3)
    if plan.name is None:
        return [*lines, "No action is applicable."]
    return lines + _wrapped("Best path: ", " → ".join(step.action for step in plan.path), wide, 2)


def _foot(drawn: int, plan: Plan, wide: int) -> list[str]:
    sentences = []
    if plan.path:
        kind = kind_of_return(plan.bound.partial)
        sentences.append(f"The number beside a first action is its {kind}.")
    sentences += special_about(plan.forecast)
    edges = plan.graph.number_of_edges()
    if drawn < edges:
        sentences.append(f"{drawn:,} of {edges:,} edges are drawn, the best ones of each layer.")
    return textwrap.wrap(" ".join(sentences), wide)


def _wrapped(before: str, text: str, wide: int, most: int) -> list[str]:
    """Return a text in at most `most` lines; none if it is empty."""
    return textwrap.wrap(before + text, wide, max_lines=most, placeholder=" …") if text else []


def _legend(branches: Sequence[Branch], plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield a sample and a text for each style that occurs."""
    line = f'<path d="M0 0H{_SAMPLE - 8:.0f}"'
    if plan.path:
        yield f"{line} {_stroke('good' if plan.safe else 'bad', 3.4)}/>", "best path"
    if others := [b.total for b in branches if not (b.harm or b.muted or b.chosen)]:
        low, high = readable(min(others)), readable(max(others))
        text = f"other path: return {low if low == high else f'{low} to {high}'}"
        yield f"{line} {_stroke('good', 1.2)}/>", text
    harms = {branch.harm for branch in branches if not branch.muted}
    for harm, text in _HARMS.items():
        if harm in harms:
            yield f"{line} {_stroke('bad', 1.2, dashes=DASHES[harm])}/>", text
    ends = {branch.end for branch in branches if branch.harm != "unsafe"}
    for end, text in _ENDS.items():
        if end in ends:
            yield _end_mark(end, _SAMPLE - 12, 0), text
