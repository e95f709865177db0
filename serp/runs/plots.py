"""The learning curve of a run."""

from __future__ import annotations

from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator, PercentFormatter

from serp._util.figures import ACTORS, FAINT, INK, STYLE, legend_above
from serp.control.decision_counts import STEPS_BY
from serp.runs.summary import WINDOW, Metrics, moving_mean

_MANY = 5_000  # episodes above which an SVG holds the points of single episodes as pixels
_BINS = 200


def learning_curve(metrics: Metrics, title: str) -> Figure:
    """Draw the returns of a run, and below them the shares of the actors and ρ.

    Without episodes the axes are empty. The figure is not registered with pyplot.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(8.0, 5.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        _draw_returns(upper, metrics)
        _draw_shares(lower, metrics)
        upper.set_title(title, pad=24)
        lower.set_xlabel("environment steps")
        lower.set_xlim(0, 1.01 * metrics["env_steps"].max(initial=1))
        lower.xaxis.set_major_formatter(EngFormatter(sep=""))
        lower.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        figure.align_ylabels([upper, lower])
    return figure


def _draw_returns(axes: Axes, metrics: Metrics) -> None:
    steps, returns = metrics["env_steps"], metrics["return"]
    points: dict[str, Any] = {
        "color": FAINT,
        "linewidth": 0.8,
        "marker": ".",
        "markersize": 3.5,
        "alpha": 0.55,
    }
    axes.plot(steps, returns, label="one episode", rasterized=len(steps) > _MANY, **points)
    label = f"mean of {WINDOW} episodes"
    axes.plot(steps, moving_mean(returns), color=INK, linewidth=2.4, label=label)
    axes.set_ylabel("return per episode")
    legend_above(axes, columns=2)


def _draw_shares(axes: Axes, metrics: Metrics) -> None:
    centres, shares = _binned_shares(metrics)
    # Most runs have no fallback steps; the legend then leaves them out.
    shown = {actor: share for actor, share in shares.items() if actor != "fallback" or share.any()}
    colors = [ACTORS[actor] for actor in shown]
    axes.stackplot(
        centres, *shown.values(), colors=colors, labels=list(shown), alpha=0.75, linewidth=0
    )
    line: dict[str, Any] = {"color": INK, "linewidth": 1.8, "label": "learner probability ρ"}
    # At 0 and 1 the frame would clip half of the line.
    axes.plot(metrics["env_steps"], metrics["rho"], clip_on=False, **line)
    axes.set_ylim(0, 1)
    axes.set_ylabel("share of decisions")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.yaxis.set_major_locator(MaxNLocator(2))
    axes.grid(False)
    legend_above(axes, columns=len(shown) + 1)


def _binned_shares(
    metrics: Metrics,
) -> tuple[np.ndarray[Any, Any], dict[str, np.ndarray[Any, Any]]]:
    """Return the shares of executed actions by actor, in at most `_BINS` bins of episodes.

    Returns:
        The env step in the middle of each bin ``[bins]`` (the outermost ones moved to the ends of
        the run), and actor → share ``[bins]``; the shares add up to 1.
    """
    ends, lengths = metrics["env_steps"], metrics["length"]
    if not len(lengths):
        return np.zeros(0), {actor: np.zeros(0) for actor in STEPS_BY}
    # Bins of equal env steps; an episode belongs to the bin in which it ends.
    width = max(ends[-1] / _BINS, 1.0)
    _, first = np.unique(np.floor((ends - 1) / width), return_index=True)
    total = np.add.reduceat(lengths, first)
    shares = {
        actor: np.add.reduceat(metrics[name], first) / total for actor, name in STEPS_BY.items()
    }
    last = np.append(first[1:], len(ends)) - 1
    begins = ends[first] - lengths[first]
    centres = (begins + ends[last]) / 2
    centres[0], centres[-1] = begins[0], ends[-1]
    if len(centres) == 1:  # an area needs two corners
        centres = np.array([begins[0], ends[-1]])
        shares = {actor: np.repeat(share, 2) for actor, share in shares.items()}
    return centres, shares
