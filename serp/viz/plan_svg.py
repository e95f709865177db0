"""Draws a planning graph in the style of the paper's Figure 1, as an SVG element.

Layers are columns, with the root on the left. An edge is blue if the best path through it has a
high return, red if the return is low or the edge harms; the best path is bold. Colour is not the
only cue: what harms is dashed, unsafe edges end in a cross, better edges are thicker. What lies
behind a harm is grey, whatever it is worth.

No library draws here: an element is made in a few milliseconds, so that an editor shows it while a
file is written.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Final, NamedTuple

from serp._util.figures import colour
from serp._util.number_format import readable
from serp.viz.plan_layout import MAX_ROWS, Branch, PlanLayout, Rest, lay_out, short

if TYPE_CHECKING:
    from serp.planning.replanner import MonitorReplanner, Plan

CHARACTER: Final = 7.4
"""Pixels of a character, on average."""
SIZE: Final = 13
"""Pixels of the letters."""
DASHES: Final = {"unsafe": "6 3", "risky": "6 2 1 2", "doomed": "1.5 3"}
"""Harm → its dashes."""
HARMS: Final = {
    "unsafe": "unsafe",
    "risky": "risk not accepted",
    "doomed": "unsafe later, whatever follows",
}
"""Harm → its name."""
ENDS: Final = {
    "ended": "the task ends",
    "elsewhere": "the same state as another here",
    "collapsed": "goes on, not drawn",
}
"""End of a branch → its name."""

_ROW: Final = 23.0
_TURN: Final = 34.0  # in which an edge turns from its source to the row of its target
_MARGIN: Final = 14.0
_CHANGES: Final = 24  # most fluents in what a tooltip says


class PlanPicture(NamedTuple):
    """The drawing of a planning graph.

    Attributes:
        lines: SVG, without the element around them.
        width, height: Pixels.
        layout: What is drawn.
    """

    lines: list[str]
    width: float
    height: float
    layout: PlanLayout


def plan_svg(plan: Plan, planner: MonitorReplanner, *, rows: int = MAX_ROWS) -> str:
    """Return the planning graph of a decision as an `svg` element for a page.

    Its colours are the page's CSS variables of the names in `serp._util.figures.PALETTE`, or else
    the light ones. Names of the file are escaped.

    Args:
        plan: The decision.
        planner: The planner of the decision. If a precondition cuts a repeated action short, the
            edge is coloured as if it were not; the numbers are those of the plan.
        rows: Rows to fill with what is best; the rest is counted.
    """
    picture = draw_plan(plan, planner, rows)
    drawn, edges = len(picture.layout.branches), plan.graph.number_of_edges()
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{picture.width:.0f}" '
            f'height="{picture.height:.0f}" role="img" '
            f'viewBox="0 0 {picture.width:.0f} {picture.height:.0f}" '
            f'aria-label="Planning graph" font-family="system-ui, sans-serif" '
            f'font-size="{SIZE}">',
            f"<desc>{drawn:,} of {edges:,} edges are drawn</desc>",
            *picture.lines,
            "</svg>",
        ]
    )


def draw_plan(plan: Plan, planner: MonitorReplanner, rows: int = MAX_ROWS) -> PlanPicture:
    """Draw the planning graph of a decision; the arguments are those of `plan_svg`."""
    forecast = plan.forecast
    labels = {
        k: f"{short(action.name)}: {readable(float(forecast.value[k]))}"
        for k, action in enumerate(planner.model.actions)
        if forecast.applicable[k]
    }
    layout = lay_out(plan.graph, planner.settings.discount**planner.settings.repeat, labels, rows)
    columns = [_MARGIN]
    for layer in range(1 + max((branch.layer for branch in layout.branches), default=-1)):
        longest = max(len(branch.label) for branch in layout.branches if branch.layer == layer)
        columns.append(columns[-1] + _TURN + 16 + CHARACTER * longest)
    drawing = _Drawing(plan, planner, layout, columns)
    lines = list(drawing.lines())
    return PlanPicture(lines, drawing.width + _MARGIN, _y(max(1.0, layout.rows)) + 14, layout)


class _Drawing:
    """Writes the edges of a layout from the worst to the best, so that the best lie on top.

    Attributes:
        width: Pixels to the right end of what has been written.
    """

    def __init__(
        self, plan: Plan, planner: MonitorReplanner, layout: PlanLayout, columns: list[float]
    ) -> None:
        self._plan, self._planner = plan, planner
        self._layout, self._columns = layout, columns
        self._fluents = planner.model.fluents
        self.width = columns[-1]

    def lines(self) -> Iterator[str]:
        """Yield every part of the drawing."""
        layout = self._layout
        if layout.rest:
            yield from self._rest(layout.rest, layout.root, 0)
        for branch in sorted(layout.branches, key=lambda branch: branch.rank, reverse=True):
            yield from self._edge(branch)
            if branch.rest:
                yield from self._rest(branch.rest, branch.row, branch.layer + 1)
        yield (
            f'<circle cx="{self._columns[0]:.1f}" cy="{_y(layout.root):.1f}" r="5.5" '
            f'style="fill:{colour("ink")}"><title>now</title></circle>'
        )
        path = [branch for branch in layout.branches if branch.chosen]
        if path:
            last = max(path, key=lambda branch: branch.layer)
            x, text = self._columns[last.layer + 1] + 11, f"return {readable(self._plan.reward)}"
            yield self._text(
                x, _y(last.row) + 4.5, text, "good" if self._plan.safe else "bad", True
            )

    def _edge(self, branch: Branch) -> Iterator[str]:
        """Yield an edge, its mark and its label."""
        shade = "bad" if branch.harm else "good"
        thick, opacity = 1.2, 1.0
        if branch.chosen:
            thick = 3.4
        elif branch.muted:
            shade = "faint"
        elif not branch.harm:
            shade = "good" if branch.value >= 0.5 else "bad"
            thick, opacity = 0.9 + 1.2 * branch.value, 0.45 + 1.1 * abs(branch.value - 0.5)
        dashes = DASHES.get(branch.harm, "")
        start = branch.parent.row if branch.parent else self._layout.root
        yield f"<g><title>{escape(self._told(branch))}</title>"
        yield self._curve(start, branch.row, branch.layer, shade, thick, opacity, dashes)
        yield mark(branch, self._columns[branch.layer + 1], _y(branch.row), shade)
        ink = shade if branch.harm or branch.chosen else "ink" if branch.layer == 0 else "faint"
        x = self._columns[branch.layer] + _TURN + 4
        yield self._text(x, _y(branch.row) - 5.5, branch.label, ink, branch.chosen)
        yield "</g>"

    def _rest(self, rest: Rest, start: float, layer: int) -> Iterator[str]:
        """Yield a stub with the number of edges that are not drawn."""
        said = f"… {rest.count:,} more"
        if rest.best is None:
            said += ", all harmful"
        else:
            said += f", none better than {readable(rest.best)}"
            if rest.harmful:
                said += f", {rest.harmful:,} of them harmful"
        yield self._curve(start, rest.row, layer, "faint", 0.8, 0.6, "1 3", stub=True)
        yield self._text(self._columns[layer] + _TURN + 4, _y(rest.row) + 4, said, "faint")

    def _curve(
        self, start: float, row: float, layer: int, shade: str, thick: float, opacity: float,
        dashes: str, *, stub: bool = False,
    ) -> str:  # fmt: skip
        x, y0, y1 = self._columns[layer], _y(start), _y(row)
        middle, turned = x + _TURN / 2, x + _TURN
        on = "" if stub else f"H{self._columns[layer + 1]:.1f}"
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        return (
            f'<path d="M{x:.1f} {y0:.1f}C{middle:.1f} {y0:.1f} {middle:.1f} {y1:.1f} {turned:.1f} '
            f'{y1:.1f}{on}" fill="none" stroke-width="{thick:.1f}" opacity="{opacity:.2f}"{dashed} '
            f'style="stroke:{colour(shade)}"/>'
        )

    def _text(self, x: float, y: float, text: str, shade: str, bold: bool = False) -> str:
        self.width = max(self.width, x + CHARACTER * len(text))
        weight = ' font-weight="600"' if bold else ""
        return (
            f'<text x="{x:.1f}" y="{y:.1f}"{weight} style="fill:{colour(shade)}">'
            f"{escape(text)}</text>"
        )

    def _told(self, branch: Branch) -> str:
        """Return what the tooltip of an edge says: what it is worth, and what it changes."""
        edge = self._plan.graph.edges[branch.source, branch.target, branch.action]
        nodes = self._plan.graph.nodes
        before, after = nodes[branch.source]["state"], nodes[branch.target]["state"]
        changes = [
            f"{fluent.name} = {readable(new) if fluent.numeric else str(bool(new)).lower()}"
            for fluent, old, new in zip(self._fluents, before, after, strict=True)
            if old != new
        ]
        said = [f"{edge['action']}: reward {readable(edge['reward'])}, "
                f"return {readable(branch.total)}"]  # fmt: skip
        said += [HARMS[branch.harm]] if branch.harm else []
        said += [ENDS[branch.end]] if branch.end in ENDS else []
        return "\n".join(said + changes[:_CHANGES])


def mark(branch: Branch, x: float, y: float, shade: str) -> str:
    """Return what is at the end of an edge."""
    if branch.harm == "unsafe":
        cross = f"M{x - 4.5:.1f} {y - 4.5:.1f}l9 9m0 -9l-9 9"
        return f'<path d="{cross}" fill="none" stroke-width="2.4" style="stroke:{colour("bad")}"/>'
    return end_mark(branch.end, x, y) or (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{4.5 if branch.chosen else 2.2}" '
        f'style="fill:{colour(shade if branch.chosen else "faint")}"/>'
    )


def end_mark(end: str, x: float, y: float) -> str:
    """Return the mark of one of `ENDS`; empty for any other end."""
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


def _y(row: float) -> float:
    return _MARGIN + _ROW * row
