"""A planning graph as a picture, in the manner of the paper's Figure 1: blue and red.

Layers stand in columns, the root on the left. An edge is blue where the best path through it is
worth much, red where it is worth little or is predicted unsafe; the best path is bold. Nothing
rests on colour alone: unsafe edges are dashed and end in a cross, promising ones are thicker.
"""

from __future__ import annotations

import io
import textwrap
from typing import TYPE_CHECKING, Any, Final

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve

from serp.graph_layout import Layout, ShownEdge, lay_out, short
from serp.planning.settings import Bound

if TYPE_CHECKING:
    import networkx as nx

    from serp.domain.model import TransitionModel
    from serp.planning.replanner import MonitorReplanner, Plan

_BLUE, _PALE_BLUE = "#0A4A94", "#9DC1E6"
_RED, _PALE_RED = "#B5271B", "#EFA99C"
_INK, _FAINT = "#1F2430", "#5B6472"
_SCALE = LinearSegmentedColormap.from_list(
    "promise", [(0, _RED), (0.5, _PALE_RED), (0.5, _PALE_BLUE), (1, _BLUE)]
)
_UNSAFE_DASHES, _DOOMED_DASHES = (0, (4, 2.2)), (0, (1, 1.8))
# Inches, where nothing else is said.
_MARGIN = 0.3
_NARROWEST = 7.2
_AFTER = 1.0  # right of the last column, for what is written there
_LINE = 0.17
_CHARACTERS_AN_INCH = 14.0
_STYLE: Final[dict[str, Any]] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.0,
    "svg.hashsalt": "serp",  # names of clip paths: random without it
    "svg.fonttype": "none",  # text stays text: it can be searched and read aloud
    "text.parse_math": False,  # a name with dollar signs is a name
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def draw_plan(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> Figure:
    """Draw the planning graph of a decision.

    A large graph is drawn in part (`serp.graph_layout.MAX_EDGES`): the best path, then layer by
    layer what follows the best states. The picture says so.

    Args:
        plan: The decision.
        planner: Who made it. Where an action that it repeats is cut short by its precondition,
            the edge is shaded as if it were not; the numbers are the plan's own.
        title: Heads the picture.

    Returns:
        A figure of its own, known to no global state of matplotlib.
    """
    graph, forecast = plan.graph, plan.forecast
    labels = {
        k: f"{short(action.name, 20)}  {_number(float(forecast.value[k]))}"
        for k, action in enumerate(planner.model.actions)
        if forecast.applicable[k]
    }
    layout = lay_out(graph, planner.settings.discount**planner.settings.repeat, labels)
    with matplotlib.style.context(["default", _STYLE]):
        return _draw(layout, graph, plan, planner, title)


def svg_bytes(figure: Figure) -> bytes:
    """Return a figure as SVG: text as text, no date, equal bytes for equal figures."""
    return _render(figure, "svg", metadata={"Date": None})


def png_bytes(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    return _render(figure, "png", dpi=150)


def _render(figure: Figure, kind: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    with matplotlib.style.context(["default", _STYLE]):
        figure.savefig(buffer, format=kind, **options)
    return buffer.getvalue()


def _draw(
    layout: Layout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, title: str
) -> Figure:
    width = max(_NARROWEST, layout.width + 2 * _MARGIN + _AFTER)
    columns = int((width - 2 * _MARGIN) * _CHARACTERS_AN_INCH)
    head = _head(planner.model, graph, plan, planner, columns)
    foot = _foot(layout, graph, plan, planner, columns)
    handles = _legend(layout, plan)
    legend_columns = max(1, min(len(handles), int(width / 1.9)))
    legend_rows = -(-len(handles) // legend_columns)
    above = _MARGIN + 0.3 + _LINE * len(head) + 0.2
    below = 0.25 + 0.2 * legend_rows + _LINE * len(foot) + _MARGIN
    height = above + layout.height + below
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)  # downwards, as rows go
    axes.axis("off")
    axes.text(_MARGIN, _MARGIN, title, fontsize=12, fontweight="bold", color=_INK, va="top")
    _write(axes, head, _MARGIN + 0.3)
    _draw_edges(axes, layout, graph, above)
    _draw_nodes(axes, layout, graph, plan, above)
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(_MARGIN, above + layout.height + 0.2),
        bbox_transform=axes.transData,
        ncols=legend_columns,
        frameon=False,
        borderaxespad=0,
        handlelength=2.6,
        columnspacing=1.8,
        labelcolor=_INK,
    )
    _write(axes, foot, height - _MARGIN - _LINE * len(foot) + 0.05)
    return figure


# The graph ---------------------------------------------------------------------------------------


def _draw_edges(axes: Axes, layout: Layout, graph: nx.MultiDiGraph, top: float) -> None:
    # The best come last, so that they lie on top.
    for edge in sorted(layout.edges, key=lambda edge: edge.rank, reverse=True):
        x0, x1 = _MARGIN + layout.x[edge.source], _MARGIN + layout.x[edge.target]
        y0, y1 = top + layout.y[edge.source], top + layout.y[edge.target]
        turned = _MARGIN + layout.turns[graph.nodes[edge.source]["layer"]]
        middle = (x0 + turned) / 2
        curve = Curve(
            [(x0, y0), (middle, y0), (middle, y1), (turned, y1), (x1, y1)],
            [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4, Curve.LINETO],
        )
        axes.add_patch(
            PathPatch(curve, fill=False, capstyle="butt", joinstyle="round", **_looks(edge))
        )
        if edge.label:
            _write_label(axes, edge, turned + 0.04, y1)


def _looks(edge: ShownEdge) -> dict[str, Any]:
    if edge.chosen:
        colour = _RED if edge.unsafe or edge.doomed else _BLUE
        style: Any = _UNSAFE_DASHES if edge.unsafe else "solid"
        return {"color": colour, "linewidth": 3.4, "linestyle": style}
    if edge.unsafe:
        return {"color": _RED, "linewidth": 1.2, "linestyle": _UNSAFE_DASHES}
    if edge.doomed:
        return {"color": _RED, "linewidth": 1.2, "linestyle": _DOOMED_DASHES}
    return {"color": _SCALE(edge.promise), "linewidth": 0.8 + 1.2 * edge.promise}


def _write_label(axes: Axes, edge: ShownEdge, x: float, y: float) -> None:
    colour = _RED if edge.unsafe or edge.doomed else _BLUE if edge.chosen else _FAINT
    axes.text(
        x,
        y - 0.025,
        edge.label,
        color=colour,
        fontweight="bold" if edge.chosen else "normal",
        fontsize=7.0,
        va="bottom",
        ha="left",
    )


def _draw_nodes(axes: Axes, layout: Layout, graph: nx.MultiDiGraph, plan: Plan, top: float) -> None:
    collapsed = set(layout.collapsed)
    chosen = {0, *(edge.target for edge in layout.edges if edge.chosen)}
    unsafe = {edge.target for edge in layout.edges if edge.unsafe}
    for node, x in layout.x.items():
        at = (_MARGIN + x, top + layout.y[node])
        if node in unsafe:
            _mark(axes, at, "X", _RED, 6.5)
        elif graph.nodes[node]["ended"]:
            _mark(axes, at, "s", _INK, 4.5)
        elif node in collapsed:
            _mark(axes, at, ">", _FAINT, 5.0)
        elif node == 0:
            _mark(axes, at, "o", _INK, 7.0)
        elif node in chosen:
            _mark(axes, at, "o", _BLUE if plan.safe else _RED, 5.0)
        else:
            _mark(axes, at, "o", _FAINT, 2.4)
    if plan.path:
        last = max(chosen)
        axes.text(
            _MARGIN + layout.x[last] + 0.12,
            top + layout.y[last],
            f"return {_number(plan.reward)}",
            color=_BLUE if plan.safe else _RED,
            fontweight="bold",
            va="center",
        )


def _mark(axes: Axes, at: tuple[float, float], marker: str, colour: str, size: float) -> None:
    axes.plot(*at, marker=marker, color=colour, markersize=size, markeredgewidth=0, zorder=3)


# What is written ---------------------------------------------------------------------------------


def _head(
    model: TransitionModel, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, wide: int
) -> list[str]:
    state = graph.nodes[0]["state"]
    numbers = [f"{f.name} = {_number(state[f.index])}" for f in model.fluents if f.numeric]
    facts = [f.name for f in model.fluents if not f.numeric and state[f.index]]
    lines = _wrapped("State: ", numbers + facts, wide, 3)
    if plan.name is None:
        return [*lines, "No action is applicable."]
    steps = [f"Best path: {plan.path[0].action}", *(step.action for step in plan.path[1:])]
    lines += _wrapped("", steps, wide, 2, " → ")
    return lines


def _foot(
    layout: Layout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, wide: int
) -> list[str]:
    settings = planner.settings
    each = f", each repeated for {settings.repeat} control periods" if settings.repeat > 1 else ""
    sentences = [
        f"Lookahead: {plan.depth} action{'' if plan.depth == 1 else 's'}{each}; "
        f"discount {settings.discount:g}"
        + (", ended by the limit on nodes." if plan.bound is Bound.NODES else ".")
    ]
    if plan.path:
        sentences.append("A number beside a first action is its best return.")
    if plan.indifferent:
        sentences.append("All first actions promise the same: the first in the file is taken.")
    if plan.path and not plan.safe:
        sentences.append("Every path leads to something unsafe: the longest safe one is taken.")
    left_out = graph.number_of_edges() - len(layout.edges)
    if left_out:
        sentences.append(
            f"Drawn are {len(layout.edges):,} of {graph.number_of_edges():,} edges: the best path, "
            "then layer by layer what follows the best states."
        )
    if layout.bare:
        sentences.append("Edges without a name: the actions as in the file, from top to bottom.")
    names = [a.name for a, ok in zip(planner.model.actions, plan.forecast.applicable, strict=True)
             if not ok]  # fmt: skip
    lines = textwrap.wrap(" ".join(sentences), wide)
    return lines + (_wrapped("Not applicable here: ", names, wide, 2) if names else [])


def _wrapped(before: str, items: list[str], wide: int, most: int, between: str = ", ") -> list[str]:
    """Return items in at most so many lines, the rest of them counted."""
    lines, line, count = [], before, 0
    for item in items:
        if len(line) + len(item) + len(between) > wide and line != before:
            if len(lines) + 1 == most:
                break
            lines.append(line)
            line = ""
        line += item + between
        count += 1
    rest = len(items) - count
    lines.append(f"{line}… {rest} more" if rest else line.removesuffix(between))
    return lines if items else []


def _write(axes: Axes, lines: list[str], y: float) -> None:
    for k, line in enumerate(lines):
        axes.text(_MARGIN, y + k * _LINE, line, color=_FAINT, va="top")


def _legend(layout: Layout, plan: Plan) -> list[Line2D]:
    """Return an entry for each look that occurs."""
    edges = layout.edges
    safe = [e for e in edges if not (e.unsafe or e.doomed)]
    high, low = (
        [e.total for e in safe if e.promise >= 0.5],
        [e.total for e in safe if e.promise < 0.5],
    )
    entries = []
    if plan.path:
        entries.append(_line("best path", color=_BLUE if plan.safe else _RED, linewidth=3.4))
    if high:
        entries.append(_line(f"promising: {_span(high)}", color=_SCALE(0.75), linewidth=1.7))
    if low:
        entries.append(_line(f"low: {_span(low)}", color=_SCALE(0.25), linewidth=1.1))
    if any(edge.unsafe for edge in edges):
        entries.append(
            _line(
                "unsafe",
                color=_RED,
                linewidth=1.2,
                linestyle=_UNSAFE_DASHES,
                marker="X",
                markersize=6.5,
                markeredgewidth=0,
            )  # fmt: skip
        )
    if any(edge.doomed for edge in edges):
        entries.append(
            _line(
                "unsafe later, whatever follows",
                color=_RED,
                linewidth=1.2,
                linestyle=_DOOMED_DASHES,
            )  # fmt: skip
        )
    return entries


def _line(label: str, **looks: Any) -> Line2D:
    return Line2D([], [], label=label, **looks)


def _span(totals: list[float]) -> str:
    low, high = _number(min(totals)), _number(max(totals))
    return f"return {low}" if low == high else f"return {low} to {high}"


def _number(value: float) -> str:
    return f"{value + 0.0:,.0f}" if abs(value) >= 1000 else f"{value + 0.0:.3g}"
