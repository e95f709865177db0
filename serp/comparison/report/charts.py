"""Charts of final numbers: points with intervals, and results over the planner's quality."""

from __future__ import annotations

from textwrap import fill
from typing import Any, Final

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from serp._util.figures import FAINT, INK, STYLE
from serp.comparison.algorithms import DQN
from serp.comparison.analysis.definitions import BY_NAME
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import Estimate
from serp.comparison.analysis.variants import VariantRow, subject, variant_rows
from serp.comparison.report.line_styles import line_styles, mark_caution, mark_cut

_PANELS: Final = ("training_area", "learner_area", "final_learner", "final_vetoed")


def estimates_chart(results: Results) -> Figure:
    """Draw a point with its interval for each algorithm, a panel for each of four measures."""
    algorithms = results.algorithms
    styles = line_styles(algorithms)
    with matplotlib.style.context(["default", STYLE]):
        height = 1.5 + 0.36 * len(algorithms)
        figure = Figure(figsize=(11.0, max(height, 2.4)), layout="constrained")
        panels = np.atleast_1d(figure.subplots(1, len(_PANELS), sharey=True))
        for axes, name in zip(panels, _PANELS, strict=True):
            for row, algorithm in enumerate(algorithms):
                found = results.estimate(algorithm, name)
                if np.isfinite(found.value):
                    style = styles[algorithm]
                    axes.errorbar(
                        found.value, row, xerr=_errors(found), color=style.colour, linewidth=2.2,
                        capsize=4, capthick=2.2, marker=style.marker, markersize=5,
                    )  # fmt: skip
            axes.set_title(fill(BY_NAME[name].title, 22), fontsize=10.5)
            axes.set_xlabel("return")
            axes.grid(axis="y", visible=False)
            axes.locator_params(axis="x", nbins=5)
            mark_cut(axes.xaxis)
        panels[0].set_yticks(range(len(algorithms)), algorithms)
        panels[0].set_ylim(len(algorithms) - 0.5, -0.5)
        for axes in panels:
            axes.tick_params(axis="y", length=0)
        mark_caution(figure, results.caution())
    return figure


def variants_chart(results: Results) -> Figure:
    """Draw final learner and area under the training curve over the return of the planner alone.

    A point is a domain file; plain DQN is the horizontal line with its interval as a band.
    """
    rows = [row for row in variant_rows(results) if np.isfinite(row.planner.value)]
    name = subject(results)
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(11.0, 4.4), layout="constrained")
        final, area = figure.subplots(1, 2)
        _panel(final, rows, [row.final for row in rows], results, "final_learner", name)
        _panel(area, rows, [row.area for row in rows], results, "training_area", name)
        entries: dict[str, Any] = {}
        for axes in (final, area):
            handles, labels = axes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        # Lines come before points in each panel's list.
        names = sorted(entries, key=lambda label: label not in {row.variant for row in rows})
        figure.legend([entries[label] for label in names], names, loc="outside right upper")
        mark_caution(figure, results.caution(*results.variants))
    return figure


def _panel(
    axes: Axes,
    rows: list[VariantRow],
    values: list[Estimate],
    results: Results,
    measure: str,
    name: str,
) -> None:
    axes.set_title(BY_NAME[measure].title)
    axes.set_xlabel("return of the planner alone (mean)")
    axes.set_ylabel(f"return with {name}")
    styles = line_styles([row.variant for row in rows])
    for row, found in zip(rows, values, strict=True):
        if np.isfinite(found.value):
            style = styles[row.variant]
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
    _diagonal(axes)
    mark_cut(axes.xaxis, axes.yaxis)


def _diagonal(axes: Axes) -> None:
    """Draw the line on which learning is worth as much as the planner alone; the limits stay."""
    limits = axes.get_xlim(), axes.get_ylim()
    axes.axline((limits[0][0], limits[0][0]), slope=1, color=FAINT, linestyle=":", linewidth=1.6,
                label="the planner's own", zorder=1)  # fmt: skip
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def _errors(found: Estimate) -> list[list[float]] | None:
    if found.low is None or found.high is None:
        return None
    return [[found.value - found.low], [found.high - found.value]]
