"""The figures of a comparison: learning curves as in the paper's Figure 2, and with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import FAINT, STYLE
from serp.comparison.analysis.curves import (
    Curves,
    episode_curves,
    evaluation_curves,
    training_curves,
    unit_curves,
)
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import CurveBand, interquartile_band, mean_band
from serp.comparison.analysis.variants import planner_returns, variant_rows
from serp.comparison.report.charts import estimates_chart, variants_chart
from serp.comparison.report.line_styles import (
    CUT,
    LineStyle,
    is_cut,
    line_styles,
    mark_caution,
    mark_cut,
)
from serp.runs.summary import WINDOW

_SMOOTHED = f"training return (mean of {WINDOW} episodes)"
_MEAN = "Mean over the seeds, shaded: one standard deviation."
_IQM = "Interquartile mean over the seeds, shaded: 95 % bootstrap interval."


_ZOOMED = f"An axis that says “{CUT.strip('()')}” does not show 0: look at its numbers."


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


def pictures(results: Results) -> tuple[Picture, ...]:
    """Draw every figure for which there are data, in the order of the report."""
    metadata = results.metadata
    budget, episodes = metadata.protocol.env_steps, metadata.protocol.evaluation_episodes
    steps = f"over {budget:,} env steps"
    smoothing = (
        f"A training curve shows the mean of the running episode and the {WINDOW - 1} before it, "
        "and goes on from the last complete episode."
    )
    fewest = "A curve ends with the seed that has the fewest, so that all seeds are in every point."
    training = {name: training_curves(results.of(name), budget) for name in results.algorithms}
    by_episode = {name: episode_curves(results.of(name)) for name in results.algorithms}
    evaluated = {name: evaluation_curves(results.of(name)) for name in results.algorithms}
    found = [
        _curves("training-paper", f"Training return {steps}", f"{_MEAN} {smoothing}",
                training, mean_band, "env steps", _SMOOTHED, metadata.threshold),
        _curves("training", f"Training return {steps}, with intervals", f"{_IQM} {smoothing}",
                training, interquartile_band, "env steps", _SMOOTHED, metadata.threshold),
        _curves("training-episodes", "Training return over episodes",
                f"{_IQM} Mean of {WINDOW} episodes (of fewer at the beginning). {fewest}",
                by_episode, interquartile_band, "episodes", _SMOOTHED, metadata.threshold),
    ]  # fmt: skip
    by_unit = {name: unit_curves(results.of(name)) for name in results.algorithms}
    if any(len(found.x) > 1 for found in by_unit.values()):
        found.append(
            _curves("training-units", f"Training return over {metadata.unit}s",
                    f"{_IQM} Mean of the episodes of a {metadata.unit}, not smoothed. {fewest}",
                    by_unit, interquartile_band, f"{metadata.unit}s",
                    f"training return (mean of a {metadata.unit})", metadata.threshold)
        )  # fmt: skip
    planner = _planner_alone(results)
    dotted = " Grey: the planner alone, which does not learn." if planner is not None else ""
    found.append(
        _curves("learner", f"The learner alone {steps}",
                f"Mean return of {episodes} episodes of the greedy learner "
                f"without planner and vetoes. {_IQM}{dotted}",
                evaluated, interquartile_band, "env steps", "return of the learner alone",
                metadata.threshold, planner)
    )  # fmt: skip
    drawn = [picture for picture in found if picture is not None]
    for picture in drawn:
        mark_caution(picture.figure, results.caution())
    if results.algorithms:
        drawn.append(
            Picture(
                "estimates",
                "All algorithms side by side",
                "Interquartile mean over the seeds with its 95 % bootstrap interval.",
                estimates_chart(results),
            )
        )
    if len(variant_rows(results)) > 1:
        drawn.append(
            Picture(
                "variants",
                "How bad may the model be?",
                "One point a domain file: what comes of training with it, over what the planner "
                "that believes it is worth alone (mean). Interquartile means with 95 % bootstrap "
                "intervals; the horizontal line and band are plain DQN, the line to beat.",
                variants_chart(results),
            )
        )
    return tuple(
        picture._replace(caption=f"{picture.caption} {_ZOOMED}")
        if is_cut(picture.figure)
        else picture
        for picture in drawn
    )


def _curves(
    name: str,
    title: str,
    caption: str,
    curves: Mapping[str, Curves],
    band: Callable[[np.ndarray[tuple[int, int], np.dtype[np.float64]]], CurveBand],
    x: str,
    y: str,
    threshold: float | None,
    planner: float | None = None,
) -> Picture | None:
    """Return a figure of a curve with its band for each algorithm; None if there is no curve."""
    shown = {algorithm: found for algorithm, found in curves.items() if found.y.size}
    if not shown:
        return None
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        axes = figure.subplots()
        styles = line_styles(list(curves))
        for rank, (algorithm, found) in enumerate(shown.items()):
            _draw(axes, found.x, band(found.y), algorithm, styles[algorithm], -rank / 1_000)
        if planner is not None:
            axes.axhline(
                planner, color=FAINT, linestyle=(0, (1, 1.5)), linewidth=2.0, label="planner alone"
            )
        if threshold is not None:
            _mark_threshold(axes, threshold)
        axes.set_title(title)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        last = max(float(found.x[-1]) for found in shown.values())
        axes.set_xlim(0 if x == "env steps" else 1, max(last, 2.0))
        mark_cut(axes.yaxis)
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        figure.legend(
            *axes.get_legend_handles_labels(), loc="outside right upper", handlelength=2.6
        )
    return Picture(name, title, caption, figure)


def _draw(
    axes: Axes,
    x: np.ndarray[tuple[int], np.dtype[np.float64]],
    band: CurveBand,
    name: str,
    style: LineStyle,
    above: float,
) -> None:
    """Draw a curve with its band, `above` those of other algorithms."""
    # A single point, such as one evaluation, would be an invisible line.
    marker = style.marker if len(x) == 1 else "none"
    axes.plot(
        x, band.centre, color=style.colour, linestyle=style.dash, linewidth=style.width, label=name,
        marker=marker, zorder=2 + above,
    )  # fmt: skip
    axes.fill_between(
        x, band.low, band.high, color=style.colour, alpha=0.16, linewidth=0, zorder=1 + above
    )


def _mark_threshold(axes: Axes, threshold: float) -> None:
    low, high = axes.get_ylim()
    if low <= threshold <= high + 0.1 * (high - low):
        axes.axhline(threshold, color=FAINT, linewidth=1.2, zorder=1.5, label="threshold")


def _planner_alone(results: Results) -> float | None:
    """Return the mean return of the planner alone on the base variant."""
    found = planner_returns(results, results.metadata.base)
    return float(found.mean()) if len(found) else None
