"""The learning curve of a run, as PNG and SVG, the same bytes for the same metrics."""

from __future__ import annotations

from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator, PercentFormatter

from serp.colours import EXPLORATION, LEARNER, PLANNER
from serp.picture import FAINT, INK, STYLE, legend_above
from serp.picture import render as render
from serp.runs.summary import WINDOW, Metrics, moving_mean

_MANY = 5_000  # episodes, above which an SVG holds the light layer as pixels
_BINS = 200


def learning_curve(metrics: Metrics, title: str = "Learning curve") -> Figure:
    """Draws a run: the returns above, below who acted and the learner probability ρ.

    Args:
        metrics: what `serp.runs.reading.read_metrics` returns; no episode gives empty axes.
        title: heads the figure.

    Returns:
        A figure of its own, known to no global state of matplotlib.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(8.0, 5.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        steps = metrics["env_steps"].astype(float)
        _draw_returns(upper, steps, metrics["return"])
        _draw_shares(lower, steps, metrics)
        upper.set_title(title, pad=24)
        lower.set_xlabel("environment steps")
        lower.set_xlim(0, 1.01 * max(float(steps[-1]), 1.0) if len(steps) else 1.0)
        lower.xaxis.set_major_formatter(EngFormatter(sep=""))
        lower.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        figure.align_ylabels([upper, lower])
    return figure


def _draw_returns(axes: Axes, steps: np.ndarray[Any, Any], returns: np.ndarray[Any, Any]) -> None:
    axes.plot(
        steps,
        returns,
        color=FAINT,
        linewidth=0.8,
        marker=".",
        markersize=3.5,
        alpha=0.55,
        label="one episode",
        rasterized=len(steps) > _MANY,
    )
    axes.plot(
        steps, moving_mean(returns), color=INK, linewidth=2.4, label=f"mean of {WINDOW} episodes"
    )
    axes.set_ylabel("return per episode")
    legend_above(axes, columns=2)


def _draw_shares(axes: Axes, steps: np.ndarray[Any, Any], metrics: Metrics) -> None:
    centres, planner, learner, exploration = _binned_shares(metrics)
    axes.stackplot(
        centres,
        planner,
        learner,
        exploration,
        colors=[PLANNER, LEARNER, EXPLORATION],
        labels=["planner", "learner", "exploration"],
        alpha=0.75,
        linewidth=0,
    )
    axes.plot(
        steps,
        metrics["rho"],
        color=INK,
        linewidth=1.8,
        label="learner probability ρ",
        clip_on=False,  # at 0 and 1 the frame would take half of the line
    )
    axes.set_ylim(0, 1)
    axes.set_ylabel("share of decisions")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.yaxis.set_major_locator(MaxNLocator(2))
    axes.grid(False)
    legend_above(axes, columns=4)


def _binned_shares(
    metrics: Metrics,
) -> tuple[np.ndarray[Any, Any], ...]:
    """Shares of planner, learner and exploration over at most `_BINS` stretches of episodes.

    Returns:
        Four arrays ``[bins]``: the env step in the middle of each stretch (the outermost ones
        drawn to the ends of the run), then the shares, which add up to 1.
    """
    lengths = metrics["length"].astype(float)
    if not len(lengths):
        return (np.zeros(0),) * 4
    ends = metrics["env_steps"].astype(float)
    # Stretches of equal env steps; an episode counts where it ends.
    width = max(ends[-1] / _BINS, 1.0)
    _, first = np.unique(np.floor((ends - 1) / width), return_index=True)
    total = np.add.reduceat(lengths, first)
    learner = np.add.reduceat(metrics["learner_steps"].astype(float), first) / total
    exploration = np.add.reduceat(metrics["exploration_steps"].astype(float), first) / total
    last = np.append(first[1:], len(ends)) - 1
    begins = ends[first] - lengths[first]
    centres = (begins + ends[last]) / 2
    centres[0], centres[-1] = begins[0], ends[-1]
    if len(centres) == 1:  # an area needs two corners
        centres = np.array([begins[0], ends[-1]])
        learner, exploration = np.repeat(learner, 2), np.repeat(exploration, 2)
    return centres, 1 - learner - exploration, learner, exploration
