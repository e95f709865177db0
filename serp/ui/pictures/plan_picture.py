"""The picture of a decision as a file: the planning graph with what there is to say of it.

The file is SVG with text as text, which can be searched and read aloud. It is light or dark as the
reader's other pages are.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Final, NamedTuple

from serp._util.figures import colour, style_sheet
from serp._util.text import readable
from serp.agent.sentences import kind_of_return, special_about
from serp.planning.edges import Bound
from serp.ui.pictures.plan_layout import MAX_ROWS, Branch, PlanLayout, Rest, lay_out, short

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
    layout = lay_out(plan.graph, planner.settings.discount, labels, rows)
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


_NARROWEST: Final = 560.0
_LINE: Final = 19.0
_EDGE: Final = 16.0  # around everything
_SAMPLE: Final = 40.0  # of a line in the legend


def plan_picture(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> bytes:
    """Return the picture of a decision as the content of an SVG file.

    A large graph is drawn in part (`plan_layout.MAX_ROWS`): the best path, and layer by
    layer what follows the best states; the rest is counted. Equal decisions give equal bytes.

    Args:
        plan: The decision.
        planner: The planner of the decision.
        title: Title of the picture.
    """
    picture = draw_plan(plan, planner)
    width = max(_NARROWEST, picture.width)
    wide = int(width / CHARACTER)
    y = _LINE
    lines = [_text(0, y, title, "ink", f' font-weight="600" font-size="{SIZE + 4}"')]
    for text in _head(plan, planner, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    y += _LINE / 2
    lines += [f'<g transform="translate(0 {y:.1f})">', *picture.lines, "</g>"]
    y += picture.height
    x = 0.0
    for sample, text in _legend(picture, plan):
        if x and x + _SAMPLE + CHARACTER * len(text) > width:
            x, y = 0.0, y + _LINE
        lines += [f'<g transform="translate({x:.1f} {y:.1f})">{sample}</g>',
                  _text(x + _SAMPLE, y + 4.5, text)]  # fmt: skip
        x += _SAMPLE + CHARACTER * (len(text) + 2)
    y += _LINE / 2
    for text in _foot(picture, plan, planner, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    all_wide, all_high = width + 2 * _EDGE, y + 2 * _EDGE
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{all_wide:.0f}" '
            f'height="{all_high:.0f}" viewBox="0 0 {all_wide:.0f} {all_high:.0f}" role="img" '
            f'font-family="system-ui, sans-serif" font-size="{SIZE}">',
            style_sheet(),
            f"<title>{escape(title)}</title>",
            f'<rect width="100%" height="100%" style="fill:{colour("surface")}"/>',
            f'<g transform="translate({_EDGE:.0f} {_EDGE / 2:.0f})">',
            *lines,
            "</g></svg>\n",
        ]
    ).encode()


def _text(x: float, y: float, text: str, shade: str = "faint", more: str = "") -> str:
    style = f'style="fill:{colour(shade)}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{more} {style}>{escape(text)}</text>'


def _head(plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    state, fluents = plan.graph.nodes[0]["state"], planner.model.fluents
    numbers = [f"{f.name} = {readable(float(state[f.index]))}" for f in fluents if f.numeric]
    facts = [f.name for f in fluents if not f.numeric and state[f.index]]
    lines = _wrapped("State: ", ", ".join(numbers + facts), wide, 3)
    if plan.name is None:
        return [*lines, "No action is applicable."]
    return lines + _wrapped("Best path: ", " → ".join(step.action for step in plan.path), wide, 2)


def _foot(picture: PlanPicture, plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    settings, layout = planner.settings, picture.layout
    sentences = []
    if plan.name is not None:
        actions = f"{plan.depth} action{'' if plan.depth == 1 else 's'}"
        ended = ", ended by the limit on nodes" if plan.bound is Bound.NODES else ""
        sentences.append(f"Lookahead: {actions}; discount {settings.discount:g}{ended}.")
    if plan.path:
        kind = kind_of_return(plan.bound.partial)
        sentences.append(f"A number beside a first action is its {kind}.")
    sentences += special_about(plan.forecast)
    edges = plan.graph.number_of_edges()
    if len(layout.branches) < edges:
        sentences.append(
            f"Drawn are {len(layout.branches):,} of {edges:,} edges: the best path, and layer by "
            "layer what follows the best states."
        )
    names = [a.name for a, ok in zip(planner.model.actions, plan.forecast.applicable, strict=True)
             if not ok]  # fmt: skip
    return [
        *textwrap.wrap(" ".join(sentences), wide),
        *_wrapped("Not applicable here: ", ", ".join(names), wide, 2),
    ]


def _wrapped(before: str, text: str, wide: int, most: int) -> list[str]:
    """Return a text in at most `most` lines; none if it is empty."""
    return textwrap.wrap(before + text, wide, max_lines=most, placeholder=" …") if text else []


def _legend(picture: PlanPicture, plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield a sample and a text for each style that occurs."""
    branches = picture.layout.branches
    if plan.path:
        yield _line("good" if plan.safe else "bad", 3.4), "best path"
    clear = [branch for branch in branches if not (branch.harm or branch.muted)]
    for name, shade, thick, high in (("high", "good", 1.8, True), ("low", "bad", 1.1, False)):
        totals = [branch.total for branch in clear if (branch.value >= 0.5) == high]
        if totals:
            low, best = readable(min(totals)), readable(max(totals))
            yield (
                _line(shade, thick, 0.75),
                f"{name}: return {low if low == best else f'{low} to {best}'}",
            )
    harms = {branch.harm for branch in branches if not branch.muted}
    for harm, text in HARMS.items():
        if harm in harms:
            yield _line("bad", 1.2, dashes=DASHES[harm]), text
    if any(branch.muted and not branch.chosen for branch in branches):
        yield _line("faint", 1.2), "behind a harm"
    ends = {branch.end for branch in branches if branch.harm != "unsafe"}
    for end, text in ENDS.items():
        if end in ends:
            yield end_mark(end, _SAMPLE - 12, 0), text


def _line(shade: str, thick: float, opacity: float = 1.0, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return (
        f'<path d="M0 0H{_SAMPLE - 8:.0f}" fill="none" stroke-width="{thick}" opacity="{opacity}"'
        f'{dashed} style="stroke:{colour(shade)}"/>'
    )
