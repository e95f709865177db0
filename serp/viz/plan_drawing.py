"""Draws a planning graph in the style of the paper's Figure 1.

Layers are columns, with the root on the left. An edge is blue if the best path through it has a
high return, red if the return is low or the edge is predicted unsafe; the best path is bold. Colour
is not the only cue: unsafe edges are dashed and end in a cross, better edges are thicker.
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

from serp.planning.limits import Bound
from serp.viz.plan_layout import Branch, PlanLayout, lay_out, short

if TYPE_CHECKING:
    import networkx as nx

    from serp.model.transition_model import TransitionModel
    from serp.planning.replanner import MonitorReplanner, Plan

_BLUE, _PALE_BLUE = "#0A4A94", "#9DC1E6"
_RED, _PALE_RED = "#B5271B", "#EFA99C"
_INK, _FAINT = "#1F2430", "#5B6472"
_SCALE = LinearSegmentedColormap.from_list(
    "promise", [(0, _RED), (0.5, _PALE_RED), (0.5, _PALE_BLUE), (1, _BLUE)]
)
_UNSAFE_DASHES, _DOOMED_DASHES = (0, (4, 2.2)), (0, (1, 1.8))
_RISKY_DASHES = (0, (4, 1.6, 1, 1.6))
_CROSS: Final[dict[str, Any]] = {"marker": "X", "color": _RED, "markersize": 6.5}
_MARKS: Final[dict[str, dict[str, Any]]] = {
    "ended": {"marker": "s", "color": _INK, "markersize": 4.5},
    "collapsed": {"marker": ">", "color": _FAINT, "markersize": 4.5},
    "elsewhere": {"marker": "o", "color": _FAINT, "markersize": 4.2, "fillstyle": "none",
                  "markeredgewidth": 0.8},
}  # fmt: skip
# Inches, where nothing else is said.
_MARGIN = 0.3
_NARROWEST = 6.4
_AFTER = 1.0  # right of the last column, for what is written there
_LINE = 0.17
_CHARACTER = 0.061
_STYLE: Final[dict[str, Any]] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.0,
    "svg.hashsalt": "serp",  # names of clip paths: random without it
    "svg.fonttype": "none",  # text stays text: it can be searched and read aloud
    "text.parse_math": False,  # names may contain dollar signs
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def draw_plan(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> Figure:
    """Draw the planning graph of a decision.

    A large graph is drawn in part (`serp.viz.plan_layout.MAX_EDGES`): the best path, then layer by
    layer what follows the best states. The picture says so.

    Args:
        plan: The decision.
        planner: The planner of the decision. If a precondition cuts a repeated action short, the
            edge is shaded as if it were not; the numbers are those of the plan.
        title: Title of the picture.

    Returns:
        A figure that is not registered with pyplot.
    """
    graph, forecast = plan.graph, plan.forecast
    labels = {
        k: f"{short(action.name, 20)}: {_number(float(forecast.value[k]))}"
        for k, action in enumerate(planner.model.actions)
        if forecast.applicable[k]
    }
    layout = lay_out(graph, planner.settings.discount**planner.settings.repeat, labels)
    with matplotlib.style.context(["default", _STYLE]):
        return _draw(layout, graph, plan, planner, title)


def svg_bytes(figure: Figure) -> bytes:
    """Return a figure as SVG: text as text, no date, equal bytes for equal figures."""
    buffer = io.BytesIO()
    with matplotlib.style.context(["default", _STYLE]):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _draw(
    layout: PlanLayout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, title: str
) -> Figure:
    width = max(_NARROWEST, layout.width + 2 * _MARGIN + _AFTER)
    columns = int((width - 2 * _MARGIN) / _CHARACTER)
    head = _head(planner.model, graph, plan, planner, columns)
    foot = _foot(layout, graph, plan, planner, columns)
    handles = _legend(layout, plan)
    legend_columns = _legend_columns(handles, width - 2 * _MARGIN)
    legend_rows = -(-len(handles) // max(1, legend_columns))
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
    _draw_branches(axes, layout, above)
    _write_return(axes, layout, plan, above)
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(_MARGIN, above + layout.height + 0.2),
        bbox_transform=axes.transData,
        ncols=max(1, legend_columns),
        frameon=False,
        borderaxespad=0,
        handlelength=2.6,
        columnspacing=1.8,
        labelcolor=_INK,
    )
    _write(axes, foot, height - _MARGIN - _LINE * len(foot) + 0.05)
    return figure


# The graph ---------------------------------------------------------------------------------------


def _draw_branches(axes: Axes, layout: PlanLayout, top: float) -> None:
    # The best come last, so that they lie on top.
    for branch in sorted(layout.branches, key=lambda branch: branch.rank, reverse=True):
        before = branch.parent
        x0 = _MARGIN + (before.x if before else 0.0)
        y0 = top + (before.y if before else layout.root)
        turned, x1, y1 = _MARGIN + branch.turned, _MARGIN + branch.x, top + branch.y
        middle = (x0 + turned) / 2
        curve = Curve(
            [(x0, y0), (middle, y0), (middle, y1), (turned, y1), (x1, y1)],
            [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4, Curve.LINETO],
        )
        axes.add_patch(
            PathPatch(curve, fill=False, capstyle="butt", joinstyle="round", **_line_style(branch))
        )
        axes.plot(x1, y1, zorder=3, **{"markeredgewidth": 0, **_mark(branch)})
        if branch.label:
            _write_label(axes, branch, turned + 0.04, y1 - 0.025, layout.size)
    axes.plot(_MARGIN, top + layout.root, "o", color=_INK, markersize=7.0, zorder=3)


def _line_style(branch: Branch) -> dict[str, Any]:
    """Return the style of the line of a branch."""
    if branch.chosen:
        dashes: Any = (0, (2, 0.8)) if branch.unsafe else "solid"
        return {"color": _RED if branch.harmful else _BLUE, "linewidth": 3.4, "linestyle": dashes}
    if branch.harmful:
        dashes = (
            _UNSAFE_DASHES if branch.unsafe else _RISKY_DASHES if branch.risky else _DOOMED_DASHES
        )
        return {"color": _RED, "linewidth": 1.2, "linestyle": dashes}
    return {"color": _SCALE(branch.promise), "linewidth": 0.8 + 1.2 * branch.promise}


def _mark(branch: Branch) -> dict[str, Any]:
    """Return the style of the marker at the end of a branch."""
    if branch.unsafe:
        return _CROSS
    if branch.end in _MARKS:
        return _MARKS[branch.end]
    if branch.chosen:
        return {"marker": "o", "color": _RED if branch.harmful else _BLUE, "markersize": 5.0}
    return {"marker": "o", "color": _FAINT, "markersize": 2.4}


def _write_label(axes: Axes, branch: Branch, x: float, y: float, size: float) -> None:
    axes.text(
        x,
        y,
        branch.label,
        color=_RED if branch.harmful else _BLUE if branch.chosen else _FAINT,
        fontweight="bold" if branch.chosen else "normal",
        fontsize=size,
        va="bottom",
    )


def _write_return(axes: Axes, layout: PlanLayout, plan: Plan, top: float) -> None:
    """Write the best return where the best path ends."""
    path = [branch for branch in layout.branches if branch.chosen]
    if path:
        last = max(path, key=lambda branch: branch.layer)
        axes.text(
            _MARGIN + last.x + 0.12,
            top + last.y,
            f"return {_number(plan.reward)}",
            color=_BLUE if plan.safe else _RED,
            fontweight="bold",
            va="center",
        )


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
    layout: PlanLayout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, wide: int
) -> list[str]:
    settings = planner.settings
    each = f", each repeated for {settings.repeat} control periods" if settings.repeat > 1 else ""
    sentences = (
        []
        if plan.name is None
        else [
            f"Lookahead: {plan.depth} action{'' if plan.depth == 1 else 's'}{each}; "
            f"discount {settings.discount:g}"
            + (", ended by the limit on nodes." if plan.bound is Bound.NODES else ".")
        ]
    )
    if plan.path:
        sentences.append("A number beside a first action is its best return.")
    if plan.indifferent:
        sentences.append("All first actions promise the same: the first in the file is taken.")
    if plan.path and not plan.safe:
        sentences.append("Every path leads to something unsafe: the least risk is taken.")
    left_out = graph.number_of_edges() - len(layout.branches)
    if left_out:
        drawn = f"{len(layout.branches):,} of {graph.number_of_edges():,} edges"
        sentences.append(
            f"Drawn are {drawn}: the best path, then layer by layer what follows the best states."
        )
    if not all(branch.label for branch in layout.branches):
        sentences.append("Edges without a name: the actions as in the file, from top to bottom.")
    names = [a.name for a, ok in zip(planner.model.actions, plan.forecast.applicable, strict=True)
             if not ok]  # fmt: skip
    lines = textwrap.wrap(" ".join(sentences), wide)
    return lines + (_wrapped("Not applicable here: ", names, wide, 2) if names else [])


def _wrapped(before: str, items: list[str], wide: int, most: int, between: str = ", ") -> list[str]:
    """Return items in at most `most` lines, ending with the number of items left out."""
    lines: list[str] = []
    line, count = before, 0
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


def _legend(layout: PlanLayout, plan: Plan) -> list[Line2D]:
    """Return an entry for each style that occurs."""
    branches = layout.branches
    safe = [branch for branch in branches if not branch.harmful]
    high = [branch.total for branch in safe if branch.promise >= 0.5]
    low = [branch.total for branch in safe if branch.promise < 0.5]
    entries = []
    if plan.path:
        entries.append(_line("best path", color=_BLUE if plan.safe else _RED, linewidth=3.4))
    if high:
        entries.append(_line(f"promising: {_span(high)}", color=_SCALE(0.75), linewidth=1.7))
    if low:
        entries.append(_line(f"low: {_span(low)}", color=_SCALE(0.25), linewidth=1.1))
    if any(branch.unsafe for branch in branches):
        entries.append(_line("unsafe", linewidth=1.2, linestyle=_UNSAFE_DASHES, **_CROSS))
    if any(branch.risky for branch in branches):
        style = {"color": _RED, "linewidth": 1.2, "linestyle": _RISKY_DASHES}
        entries.append(_line("risk not accepted", **style))
    if any(branch.doomed for branch in branches):
        style = {"color": _RED, "linewidth": 1.2, "linestyle": _DOOMED_DASHES}
        entries.append(_line("unsafe later, whatever follows", **style))
    for end, text in (
        ("ended", "the task ends"),
        ("elsewhere", "the same state as another here"),
        ("collapsed", "goes on, not drawn"),
    ):
        if any(branch.end == end and not branch.unsafe for branch in branches):
            entries.append(_line(text, linestyle="none", **_MARKS[end]))
    return entries


def _legend_columns(entries: list[Line2D], width: float) -> int:
    """Return the number of columns of the legend: one per entry if they fit."""
    widths = [_CHARACTER * len(str(entry.get_label())) + 0.75 for entry in entries]
    if sum(widths) <= width:
        return len(widths)
    return max(1, int(width / max(widths)))


def _line(label: str, **style: Any) -> Line2D:
    return Line2D([], [], label=label, **{"markeredgewidth": 0, **style})


def _span(totals: list[float]) -> str:
    low, high = _number(min(totals)), _number(max(totals))
    return f"return {low}" if low == high else f"return {low} to {high}"


def _number(value: float) -> str:
    value += 0.0  # no negative zero
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.3g}"
