"""Charts of final numbers: points with intervals, and results over the planner's quality."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from serp._util.figures import INK, LINE, PALETTE
from serp.comparison.algorithms import DQN
from serp.comparison.analysis.definitions import BY_NAME
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import Estimate
from serp.comparison.analysis.variants import subject, variant_rows

_PANELS: Final = ("training_area", "learner_area", "final_learner", "final_vetoed")

# Okabe and Ito's palette, told apart by colour-blind readers too, without its yellow, which does
# not show on white. The numbers of colours, dashes and markers share no divisor, so that 140
# algorithms differ.
_COLOURS: Final = ("vermilion", "blue", "green", "purple", "sky", "orange", "ink")
_DASHES: Final[tuple[Any, ...]] = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_MARKERS: Final = ("o", "s", "^", "D", "v")


class LineStyle(NamedTuple):
    """The style of an algorithm in all figures, in matplotlib's terms; the first's is widest."""

    colour: str
    dash: Any
    marker: str
    width: float


def line_styles(algorithms: Sequence[str]) -> dict[str, LineStyle]:
    """Return the style of each algorithm, by its place in the comparison."""
    return {
        name: LineStyle(
            PALETTE[_COLOURS[i % len(_COLOURS)]][0],
            _DASHES[i % len(_DASHES)],
            _MARKERS[i % len(_MARKERS)],
            2.6 if i == 0 else 1.7,
        )
        for i, name in enumerate(algorithms)
    }


def estimates_chart(results: Results) -> Figure:
    """Draw a point with its interval for each algorithm, a panel for each measure with values."""
    algorithms = results.algorithms
    measured = [
        name
        for name in _PANELS
        if any(np.isfinite(results.estimate(each, name).value) for each in algorithms)
    ] or _PANELS[:1]
    height = max(1.5 + 0.36 * len(algorithms), 2.4)
    figure = Figure(figsize=(11.0, height), layout="constrained")
    panels = figure.subplots(1, len(measured), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, measured, strict=True):
        for row, (algorithm, style) in enumerate(line_styles(algorithms).items()):
            found = results.estimate(algorithm, name)
            if np.isfinite(found.value):
                axes.errorbar(
                    found.value, row, xerr=_errors(found), color=style.colour, linewidth=2.2,
                    capsize=4, capthick=2.2, marker=style.marker, markersize=5,
                )  # fmt: skip
        axes.set_title(fill(BY_NAME[name].title, 22), fontsize=10.5)
        axes.set_xlabel("return")
        axes.grid(axis="y", visible=False)
        axes.locator_params(axis="x", nbins=5)
        axes.tick_params(axis="y", length=0)
    panels[0].set_yticks(range(len(algorithms)), algorithms)
    panels[0].set_ylim(len(algorithms) - 0.5, -0.5)
    return figure


def variants_chart(results: Results) -> Figure:
    """Draw final learner and area under the training curve over the return of the planner alone.

    A point is a domain file; plain DQN is the horizontal line with its interval as a band.
    """
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    final, area = figure.subplots(1, 2)
    _panel(final, results, "final_learner")
    _panel(area, results, "training_area")
    entries: dict[str, Any] = {}
    for axes in (final, area):
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(entries.values(), entries.keys(), loc="outside right upper")
    return figure


def _panel(axes: Axes, results: Results, measure: str) -> None:
    name = subject(results)
    axes.set_title(BY_NAME[measure].title)
    axes.set_xlabel("return of the planner alone (mean)")
    axes.set_ylabel(f"return with {name}")
    rows = [row for row in variant_rows(results) if np.isfinite(row.planner.value)]
    styles = line_styles([row.variant for row in rows])
    for row in rows:
        style, found = styles[row.variant], results.estimate(name, measure, row.variant)
        if np.isfinite(found.value):
            axes.errorbar(
                row.planner.value, found.value, xerr=_errors(row.planner), yerr=_errors(found),
                color=style.colour, marker=style.marker, markersize=8,
                markeredgecolor="white", markeredgewidth=0.7,
                linewidth=1.8, linestyle="none", label=row.variant, zorder=3,
            )  # fmt: skip
    plain = results.estimate(DQN, measure)
    if np.isfinite(plain.value):
        axes.axhline(plain.value, color=INK, linestyle=(0, (5, 1.6)), linewidth=1.8,
                     label=f"{DQN}, no planner")  # fmt: skip
        if plain.low is not None and plain.high is not None:
            axes.axhspan(plain.low, plain.high, color=INK, alpha=0.1, linewidth=0)
    axes.margins(x=0.08, y=0.08)
    axes.autoscale_view()
    # The line on which learning is worth as much as the planner alone; the limits stay.
    limits = axes.get_xlim(), axes.get_ylim()
    axes.axline((limits[0][0], limits[0][0]), slope=1, color=LINE, linestyle=":", linewidth=1.6,
                label="the planner's own", zorder=1)  # fmt: skip
    axes.set(xlim=limits[0], ylim=limits[1])


def _errors(found: Estimate) -> list[list[float]] | None:
    if found.low is None or found.high is None:
        return None
    return [[found.value - found.low], [found.high - found.value]]
