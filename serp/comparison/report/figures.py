"""The figures of a comparison: learning curves with intervals, and final numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import matplotlib.style
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import INK, LINE, STYLE, label_ends
from serp.comparison.analysis.curves import (
    Curves,
    evaluation_curves,
    training_curves,
)
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import interquartile_band
from serp.comparison.analysis.variants import planner_returns, variant_rows
from serp.comparison.report.charts import estimates_chart, line_styles, variants_chart
from serp.comparison.trial_records import Record
from serp.runs.summary import WINDOW

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
