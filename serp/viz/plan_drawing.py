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

from serp._util.figures import STYLE
from serp.planning.limits import Bound
from serp.viz.plan_layout import Branch, PlanLayout, lay_out, short

if TYPE_CHECKING:
    import networkx as nx

    from serp.planning.replanner import MonitorReplanner, Plan

_BLUE, _PALE_BLUE = "#0A4A94", "#9DC1E6"
_RED, _PALE_RED = "#B5271B", "#EFA99C"
_INK, _FAINT = "#1F2430", "#5B6472"
_SCALE = LinearSegmentedColormap.from_list(
    "return", [(0, _RED), (0.5, _PALE_RED), (0.5, _PALE_BLUE), (1, _BLUE)]
)
_CROSS: Final = {"marker": "X", "color": _RED, "markersize": 6.5}
_HARMS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "unsafe": ("unsafe", {"linestyle": (0, (4, 2.2)), **_CROSS}),
    "risky": ("risk not accepted", {"linestyle": (0, (4, 1.6, 1, 1.6)), "color": _RED}),
    "doomed": ("unsafe later, whatever follows", {"linestyle": (0, (1, 1.8)), "color": _RED}),
}
"""Harm → its name, its style."""
_ENDS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "ended": ("the task ends", {"marker": "s", "color": _INK, "markersize": 4.5}),
    "elsewhere": ("the same state as another here",
                  {"marker": "o", "color": _FAINT, "markersize": 4.2, "fillstyle": "none",
                   "markeredgewidth": 0.8}),
    "collapsed": ("goes on, not drawn", {"marker": ">", "color": _FAINT, "markersize": 4.5}),
}  # fmt: skip
"""End of a branch → its name, its style."""
_DENSITIES: Final = ((72, 0.175, 7.0), (130, 0.13, 6.0), (10**9, 0.175, 7.0))
"""Up to so many rows: inches of a row, size of the labels."""
_NARROWEST: Final = 5.8  # inches
_CHARACTER: Final = 0.061  # inches of a character in the text above and below
_TURN: Final = 0.45  # inches in which an edge turns from its source to the row of its target
_STYLE: Final[dict[str, Any]] = {
    **STYLE,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.0,
    "legend.fontsize": 8.0,
    "svg.fonttype": "none",  # text stays text: it can be searched and read aloud
}


def draw_plan(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> Figure:
    """Draw the planning graph of a decision.

    A large graph is drawn in part (`serp.viz.plan_layout.MAX_EDGES`): the best path, and layer by
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
        figure.savefig(
            buffer, format="svg", metadata={"Date": None}, bbox_inches="tight", pad_inches=0.3
        )
    return buffer.getvalue()


def _draw(
    layout: PlanLayout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, title: str
) -> Figure:
    branches = layout.branches
    height, size = next((h, s) for most, h, s in _DENSITIES if layout.rows <= most)
    longest = max((len(branch.label) for branch in branches), default=0)
    column = _TURN + 0.25 + 0.63 * size / 72 * longest
    layers = 1 + max((branch.layer for branch in branches), default=0)
    width = max(_NARROWEST, layers * column)
    columns = int(width / _CHARACTER)
    head = _head(graph, plan, planner, columns)
    figure = Figure(figsize=(width, height * (layout.rows + 1)))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width / column)
    axes.set_ylim(layout.rows, -1)  # downwards, as rows go
    axes.axis("off")
    axes.annotate("\n".join(head), (0, 1), (0, 6), "axes fraction", "offset points", color=_FAINT,
                  linespacing=1.4)  # fmt: skip
    axes.set_title(title, pad=14 + 11.5 * len(head))
    # The best come last, so that they lie on top.
    for branch in sorted(branches, key=lambda branch: branch.rank, reverse=True):
        _draw_branch(axes, branch, layout.root, _TURN / column, size)
    axes.plot(0, layout.root, "o", color=_INK, markersize=7.0, zorder=3, clip_on=False)
    _write_return(axes, layout, plan)
    axes.legend(
        handles=_legend(layout, plan) or [Line2D([], [], label=" ", linestyle="none")],
        title="\n".join(_foot(layout, graph, plan, planner, columns)),
        alignment="left",
        loc="upper left",
        bbox_to_anchor=(0, 0),
        ncols=max(1, int(width / 2.2)),
        borderaxespad=0.8,
        handlelength=2.6,
        columnspacing=1.8,
    ).get_title().set_color(_FAINT)
    return figure


# The graph ---------------------------------------------------------------------------------------


def _draw_branch(axes: Axes, branch: Branch, root: float, turn: float, size: float) -> None:
    x0, y0 = branch.layer, branch.parent.row if branch.parent else root
    turned, x1, y1 = x0 + turn, x0 + 1, branch.row
    middle = (x0 + turned) / 2
    curve = Curve(
        [(x0, y0), (middle, y0), (middle, y1), (turned, y1), (x1, y1)],
        [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4, Curve.LINETO],
    )
    colour = _RED if branch.harm else _BLUE
    line: dict[str, Any] = {"color": colour, "linewidth": 3.4}
    if branch.chosen:
        line["linestyle"] = (0, (2, 0.8)) if branch.harm == "unsafe" else "solid"
    elif branch.harm:
        line |= {"linewidth": 1.2, "linestyle": _HARMS[branch.harm][1]["linestyle"]}
    else:
        line = {"color": _SCALE(branch.value), "linewidth": 0.8 + 1.2 * branch.value}
    patch = PathPatch(curve, fill=False, capstyle="butt", joinstyle="round", **line)
    axes.add_patch(patch).set_clip_on(False)
    mark: dict[str, Any] = {"marker": "o", "color": _FAINT, "markersize": 2.4}
    if branch.harm == "unsafe":
        mark = _CROSS
    elif branch.end in _ENDS:
        mark = _ENDS[branch.end][1]
    elif branch.chosen:
        mark = {"marker": "o", "color": colour, "markersize": 5.0}
    axes.plot(x1, y1, zorder=3, clip_on=False, **{"markeredgewidth": 0, **mark})
    faint = _FAINT if not (branch.harm or branch.chosen) else colour
    weight = "bold" if branch.chosen else "normal"
    axes.annotate(branch.label, (turned, y1), (3, 3.5), textcoords="offset points", color=faint,
                  fontweight=weight, fontsize=size)  # fmt: skip


def _write_return(axes: Axes, layout: PlanLayout, plan: Plan) -> None:
    """Write the best return where the best path ends."""
    path = [branch for branch in layout.branches if branch.chosen]
    if path:
        last = max(path, key=lambda branch: branch.layer)
        axes.annotate(
            f"return {_number(plan.reward)}",
            (last.layer + 1, last.row),
            (9, 0),
            textcoords="offset points",
            color=_BLUE if plan.safe else _RED,
            fontweight="bold",
            va="center",
        )


# What is written ---------------------------------------------------------------------------------


def _head(graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    state, fluents = graph.nodes[0]["state"], planner.model.fluents
    numbers = [f"{f.name} = {_number(state[f.index])}" for f in fluents if f.numeric]
    facts = [f.name for f in fluents if not f.numeric and state[f.index]]
    lines = _wrapped("State: ", ", ".join(numbers + facts), wide, 3)
    if plan.name is None:
        return [*lines, "No action is applicable."]
    return lines + _wrapped("Best path: ", " → ".join(step.action for step in plan.path), wide, 2)


def _foot(
    layout: PlanLayout, graph: nx.MultiDiGraph, plan: Plan, planner: MonitorReplanner, wide: int
) -> list[str]:
    settings = planner.settings
    sentences = []
    if plan.name is not None:
        actions = f"{plan.depth} action{'' if plan.depth == 1 else 's'}"
        if settings.repeat > 1:
            actions += f", each repeated for {settings.repeat} control periods"
        ended = ", ended by the limit on nodes" if plan.bound is Bound.NODES else ""
        sentences.append(f"Lookahead: {actions}; discount {settings.discount:g}{ended}.")
    if plan.path:
        sentences.append("A number beside a first action is its best return.")
    if plan.indifferent:
        sentences.append("All first actions promise the same: the first in the file is taken.")
    if plan.path and not plan.safe:
        sentences.append("Every path leads to something unsafe: the least risk is taken.")
    if len(layout.branches) < graph.number_of_edges():
        drawn = f"{len(layout.branches):,} of {graph.number_of_edges():,} edges"
        sentences.append(
            f"Drawn are {drawn}: the best path, and layer by layer what follows the best states."
        )
    if not all(branch.label for branch in layout.branches):
        sentences.append("Edges without a name: the actions as in the file, from top to bottom.")
    names = [a.name for a, ok in zip(planner.model.actions, plan.forecast.applicable, strict=True)
             if not ok]  # fmt: skip
    return [
        *textwrap.wrap(" ".join(sentences), wide),
        *_wrapped("Not applicable here: ", ", ".join(names), wide, 2),
    ]


def _wrapped(before: str, text: str, wide: int, most: int) -> list[str]:
    """Return a text in at most `most` lines; none if it is empty."""
    return textwrap.wrap(before + text, wide, max_lines=most, placeholder=" …") if text else []


def _legend(layout: PlanLayout, plan: Plan) -> list[Line2D]:
    """Return an entry for each style that occurs."""
    branches = layout.branches
    entries = []
    if plan.path:
        entries.append(_line("best path", color=_BLUE if plan.safe else _RED, linewidth=3.4))
    for name, high, place, thickness in (("high", True, 0.75, 1.7), ("low", False, 0.25, 1.1)):
        totals = [b.total for b in branches if not b.harm and (b.value >= 0.5) == high]
        if totals:
            low, best = _number(min(totals)), _number(max(totals))
            span = low if low == best else f"{low} to {best}"
            line = _line(f"{name}: return {span}", color=_SCALE(place), linewidth=thickness)
            entries.append(line)
    harms = {branch.harm for branch in branches}
    entries += [_line(text, linewidth=1.2, **style)
                for harm, (text, style) in _HARMS.items() if harm in harms]  # fmt: skip
    ends = {branch.end for branch in branches if branch.harm != "unsafe"}
    entries += [_line(text, linestyle="none", **style)
                for end, (text, style) in _ENDS.items() if end in ends]  # fmt: skip
    return entries


def _line(label: str, **style: Any) -> Line2D:
    return Line2D([], [], label=label, **{"markeredgewidth": 0, **style})


def _number(value: float) -> str:
    value += 0.0  # no negative zero
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.3g}"
