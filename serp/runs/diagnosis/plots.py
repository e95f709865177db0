"""Pictures of predicted against observed changes, a panel for each ground action and fluent."""

from __future__ import annotations

from typing import Final, Literal

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from serp._util.figures import FAINT, INK, PALETTE, PLANNER, STYLE, render
from serp._util.text import readable
from serp.model.transition_model import Vector
from serp.runs.diagnosis.accuracy import END, REWARD
from serp.runs.diagnosis.diagnosis import Diagnosis, FitRow

PANELS: Final = 12
"""Most panels of a picture."""

_WRITTEN: Final = PALETTE["vermilion"][0]
_FOUND: Final = PLANNER
_POINTS: Final = 600
_AREA: Final = 7.0  # of one step's point; that of equal steps grows with their number
_LARGEST: Final = 300.0
_COLUMNS: Final = 4
_NAME: Final = 34  # characters of a title


def picture(diagnosis: Diagnosis, kind: Literal["png", "svg"]) -> bytes:
    """Return the bytes of a picture file, equal for equal diagnoses."""
    return render(draw_diagnosis(diagnosis), kind)


def draw_diagnosis(diagnosis: Diagnosis) -> Figure:
    """Draw predicted against observed changes of at most 12 pairs of action and fluent.

    Reward and end count as fluents. The most costly pairs come first; if the file predicts all of
    them exactly, the pairs with the largest changes are drawn.

    Returns:
        A figure outside matplotlib's global state.
    """
    fits = panels_of(diagnosis)
    wide = min(_COLUMNS, max(1, len(fits)))
    high = max(1, -(-len(fits) // wide))
    with matplotlib.style.context(["default", STYLE, {"font.size": 9, "axes.titlesize": 10}]):
        size = max(5.6, 3.1 * wide + 0.4), 2.9 * high + 1.0
        figure = Figure(figsize=size, layout="constrained")
        for position, fit in enumerate(fits):
            axes = figure.add_subplot(high, wide, position + 1)
            _draw(axes, diagnosis, fit)
            if position % wide == 0:
                axes.set_ylabel("observed change")
            if position + wide >= len(fits):  # none below it
                axes.set_xlabel("predicted change")
        figure.suptitle(
            f"Predicted against observed: {diagnosis.recorded.domain.name}, "
            f"{len(diagnosis.sample):,} single steps",
            fontsize=13, fontweight="bold", x=0.01, horizontalalignment="left",
        )  # fmt: skip
        if fits:
            entries = {
                label: handle
                for axes in figure.axes
                for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
            }
            figure.legend(entries.values(), entries.keys(), loc="outside lower center",
                          ncols=3, markerscale=2)  # fmt: skip
    return figure


def panels_of(diagnosis: Diagnosis) -> list[FitRow]:
    """Return the pairs of action and fluent that are drawn, in their order."""
    wrong = [fit for fit in diagnosis.fits if fit.cost > 0.0]
    moving = sorted(diagnosis.fits, key=lambda fit: -fit.change / (fit.scale or 1.0))
    return (wrong or [fit for fit in moving if fit.change > 0.0])[:PANELS]


def _draw(axes: Axes, diagnosis: Diagnosis, fit: FitRow) -> None:
    model, steps = diagnosis.recorded.model, diagnosis.steps
    column = [*(fluent.name for fluent in model.fluents), REWARD, END].index(fit.fluent)
    action = [action.name for action in model.actions].index(fit.action)
    rows = np.flatnonzero(diagnosis.sample.actions == action)
    changes = np.stack(
        [
            after[rows, column] - steps.before[rows, column]
            for after in (steps.after, steps.predicted, diagnosis.expected)
        ]
    )
    changes = changes[:, np.isfinite(changes).all(axis=0)]
    title = f"{fit.action}: {fit.fluent}"
    axes.set_title(title if len(title) <= _NAME else title[: _NAME - 1] + "…", pad=18)
    better = fit.rmse_found != fit.rmse_written
    found = f" → {readable(fit.rmse_found)}" if better else ", nothing found"
    axes.text(
        0.0, 1.02, f"error {readable(fit.rmse_written)}{found}",
        transform=axes.transAxes, fontsize=8, color=FAINT, verticalalignment="bottom",
    )  # fmt: skip
    few = np.unique(np.linspace(0, changes.shape[1] - 1, _POINTS).astype(int))
    _scatter(axes, changes[1, few], changes[0, few], _WRITTEN, "file as written")
    if better:
        _scatter(axes, changes[2, few], changes[0, few], _FOUND, "with what was found")
    low, high = float(changes.min()), float(changes.max())
    margin = 0.1 * (high - low) or 1.0
    ends = low - margin, high + margin
    axes.plot(ends, ends, color=INK, linewidth=0.8, zorder=0.5, label="where both are equal")
    axes.set_xlim(*ends)
    axes.set_ylim(*ends)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter(FuncFormatter(lambda value, _: readable(value)))


def _scatter(axes: Axes, predicted: Vector, observed: Vector, colour: str, label: str) -> None:
    """Draw a point for each distinct pair, the larger the more steps it has."""
    pairs = np.round(np.stack((predicted, observed)), 6) + 0.0
    (x, y), counts = np.unique(pairs, axis=1, return_counts=True)
    area = np.minimum(_AREA * counts**0.75, _LARGEST)
    axes.scatter(x, y, s=area, color=colour, alpha=0.45, linewidths=0, rasterized=True, label=label)
