"""The learning curve of a run as a figure."""

from __future__ import annotations

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator, PercentFormatter

from serp._util.figures import ACTORS, INK, LINE, STYLE, caption, legend
from serp.runs.summary import WINDOW, Metrics, binned_shares, moving_interval, moving_mean


def learning_curve(metrics: Metrics, title: str) -> Figure:
    """Draw the returns of a run, and below them the shares of the actors and ρ.

    Without episodes the axes are empty. The figure is not registered with pyplot.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(8.0, 5.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        lower.set_xlabel("environment steps")
        lower.set_xlim(0, metrics["env_steps"].max(initial=1))
        lower.xaxis.set_major_formatter(EngFormatter(sep=""))
        lower.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        _draw_returns(upper, metrics)
        _draw_shares(lower, metrics)
        upper.set_title(title, pad=24)
        figure.align_ylabels([upper, lower])
    return figure


def _draw_returns(axes: Axes, metrics: Metrics) -> None:
    steps, returns = metrics["env_steps"], metrics["return"]
    mean, (low, high) = moving_mean(returns), moving_interval(returns)
    # Of many episodes an SVG holds the points as pixels.
    many = len(steps) > 5_000
    axes.plot(
        steps, returns, color=LINE, linestyle="none", marker=".", markersize=4, alpha=0.4,
        markeredgewidth=0, rasterized=many, clip_on=False,
    )  # fmt: skip
    axes.fill_between(steps, low, high, color=INK, alpha=0.13, linewidth=0, rasterized=many)
    axes.plot(steps, mean, color=INK, linewidth=2.4)
    axes.set_ylabel("return per episode")
    caption(axes, f"line: mean of the last {WINDOW} episodes · band: its 95 % interval · points: "
                  "single episodes")  # fmt: skip


def _draw_shares(axes: Axes, metrics: Metrics) -> None:
    centres, shares = binned_shares(metrics)
    # Most runs have no fallback steps; they are then left out.
    shown = {actor: share for actor, share in shares.items() if actor != "fallback" or share.any()}
    colors = [ACTORS[actor] for actor in shown]
    axes.stackplot(centres, *shown.values(), labels=shown, colors=colors, alpha=0.75, linewidth=0)
    says = "areas: who decided"
    if np.isfinite(rho := metrics["rho"]).any():
        # At 0 and 1 the frame would clip half of the line.
        axes.plot(metrics["env_steps"], rho, color=INK, linewidth=1.8, clip_on=False, label="ρ")
        says += " · line: ρ, the probability that the learner is asked"
    legend(axes)
    axes.set_ylim(0, 1)
    axes.set_ylabel("share of decisions")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.yaxis.set_major_locator(MaxNLocator(2))
    axes.grid(False)
    caption(axes, says)
