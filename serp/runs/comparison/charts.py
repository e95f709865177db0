"""Charts of final numbers: points with intervals, and results over the planner's quality."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill
from typing import Any, Final, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import INK, LINE, PALETTE, STYLE, label_ends
from serp.runs.comparison.algorithms import DQN
from serp.runs.comparison.measures import BY_NAME, Results, planner_returns, subject, variant_rows
from serp.runs.comparison.plan import Record
from serp.runs.comparison.statistics import (
    Curves,
    Estimate,
    evaluation_curves,
    interquartile_band,
    training_curves,
)
from serp.runs.summary import WINDOW

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


_SMOOTHED = f"training return (mean of {WINDOW} episodes)"
_IQM = "Interquartile mean over the seeds, shaded: 95 % bootstrap interval; faint: each seed."
_RUNNING = (
    f"A training curve shows the mean of the running episode and the {WINDOW - 1} before it, and "
    "goes on from the last complete episode."
)


class Picture(NamedTuple):
    """A figure of the report.

    Attributes:
        name: Of its files, without the ending.
        title: What it shows, in short.
        caption: How to read it, in sentences.
        figure: Drawn.
    """

    name: str
    title: str
    caption: str
    figure: Figure


class _Curve(NamedTuple):
    """What a figure of curves shows: a curve of each algorithm's records with a band."""

    name: str
    title: str
    caption: str
    y: str
    curves: Callable[[Sequence[Record]], Curves]


def pictures(results: Results) -> list[Picture]:
    """Draw every figure for which there are data, in the order of the report."""
    with matplotlib.style.context(["default", STYLE]):
        drawn = [
            Picture(what.name, what.title, what.caption, figure)
            for what in _curves(results)
            if (figure := _draw(results, what)) is not None
        ]
        if results.algorithms:
            caption = "Interquartile mean over the seeds with its 95 % bootstrap interval."
            figure = estimates_chart(results)
            drawn.append(Picture("estimates", "All algorithms side by side", caption, figure))
        if len(variant_rows(results)) > 1:
            caption = (
                "One point a domain file: what comes of training with it, over what the planner "
                "that believes it is worth alone (mean). Interquartile means with 95 % bootstrap "
                "intervals; the horizontal line and band are plain DQN, the line to beat."
            )
            figure = variants_chart(results)
            drawn.append(Picture("variants", "How bad may the model be?", caption, figure))
        if results.caution is not None:
            for picture in drawn:
                picture.figure.supxlabel(results.caution, fontsize=9.5, color=INK)
    return drawn


def _curves(results: Results) -> list[_Curve]:
    protocol = results.plan.protocol
    steps = f"over {protocol.env_steps:,} env steps"
    planned = len(planner_returns(results, results.plan.base))
    grey = " Grey: the planner alone, which does not learn." if planned else ""
    training = partial(training_curves, env_steps=protocol.env_steps)
    return [
        _Curve("training", f"Training return {steps}", f"{_IQM} {_RUNNING}",
               _SMOOTHED, training),
        _Curve("learner", f"The learner alone {steps}",
               f"Mean return of {protocol.evaluation_episodes} episodes of the greedy learner "
               f"without planner and vetoes. {_IQM}{grey}",
               "return of the learner alone", evaluation_curves),
    ]  # fmt: skip


def _draw(results: Results, what: _Curve) -> Figure | None:
    """Return a figure of a curve with its band for each algorithm; None if there is no curve."""
    curves = {name: what.curves(results.of(name)) for name in results.algorithms}
    shown = {name: found for name, found in curves.items() if found.y.size}
    last = max((float(found.x[-1]) for found in shown.values()), default=0.0)
    if not shown:
        return None
    height = max(4.6, 0.22 * len(shown) + 1.5)
    figure = Figure(figsize=(9.0, height), layout="constrained")
    axes = figure.subplots()
    styles = line_styles(list(curves))
    ends = []
    for rank, (name, found) in enumerate(shown.items()):
        style, band, above = styles[name], interquartile_band(found.y), -rank / 1_000
        # A single point, such as one evaluation, would be an invisible line.
        marker = style.marker if len(found.x) == 1 else "none"
        axes.plot(
            found.x, band.centre, color=style.colour, linestyle=style.dash, linewidth=style.width,
            label=name, marker=marker, zorder=2 + above,
        )  # fmt: skip
        axes.fill_between(
            found.x, band.low, band.high, color=style.colour, alpha=0.16, linewidth=0,
            zorder=1 + above,
        )  # fmt: skip
        seeds: dict[str, Any] = {
            "color": style.colour,
            "linewidth": 0.7,
            "alpha": 0.25,
            "label": "_seed",
        }
        axes.plot(found.x, found.y.T, zorder=0.5, **seeds)
        ends.append((name, float(band.centre[-1]), style.colour))
    planner = planner_returns(results, results.plan.base)
    if what.name == "learner" and len(planner):
        axes.axhline(planner.mean(), color=LINE, linestyle=(0, (1, 1.5)), linewidth=2.0,
                     label="planner alone")  # fmt: skip
        ends.append(("planner alone", float(planner.mean()), LINE))
    threshold = results.plan.threshold
    low, high = axes.get_ylim()
    if threshold is not None and low <= threshold <= high + 0.1 * (high - low):
        axes.axhline(threshold, color=LINE, linewidth=1.2, zorder=1.5, label="threshold")
        ends.append(("threshold", threshold, LINE))
    axes.set(title=what.title, xlabel="env steps", ylabel=what.y)
    axes.set_xlim(0, max(last, 2.0))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    label_ends(axes, ends, height - 1.2)
    return figure
