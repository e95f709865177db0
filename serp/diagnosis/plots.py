"""Pictures of predicted against observed changes, a panel for each ground action and fluent."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final, Literal

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from serp._util.figures import FAINT, INK, PLANNER, STYLE, render
from serp._util.number_format import number
from serp.diagnosis.diagnosis import Diagnosis, FitRow
from serp.model.transition_model import Vector
from serp.sysid.monitor import END, REWARD

PANELS: Final = 12
"""Most panels of a picture."""

_WRITTEN: Final = "#D55E00"
_FOUND: Final = PLANNER
_POINTS: Final = 600
_VALUES: Final = 6
"""Most distinct changes of a fluent that is shown as a table."""

_COLUMNS: Final = 4
_NAME: Final = 30  # characters of a title


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
    names = [*(fluent.name for fluent in diagnosis.recorded.model.fluents), REWARD, END]
    actions = {a.name: k for k, a in enumerate(diagnosis.recorded.model.actions)}
    fits = panels_of(diagnosis)
    wide = min(_COLUMNS, max(1, len(fits)))
    high = max(1, -(-len(fits) // wide))
    kinds = set()
    with matplotlib.style.context(["default", STYLE, {"font.size": 9, "axes.titlesize": 10}]):
        figure = Figure(
            figsize=(max(5.6, 3.1 * wide + 0.4), 2.9 * high + 1.0), layout="constrained"
        )
        for position, fit in enumerate(fits):
            axes = figure.add_subplot(high, wide, position + 1)
            kinds.add(_draw(axes, diagnosis, fit, actions[fit.action], names.index(fit.fluent)))
            if position % wide == 0:
                axes.set_ylabel("observed change")
            if position + wide >= len(fits):  # none below it
                axes.set_xlabel("predicted change")
        if not fits:
            figure.add_subplot(1, 1, 1).set_axis_off()
        figure.suptitle(
            f"Predicted against observed: {diagnosis.recorded.domain.name}, "
            f"{len(diagnosis.sample):,} single steps",
            fontsize=13, fontweight="bold", x=0.01, horizontalalignment="left",
        )  # fmt: skip
        figure.legend(handles=_legend(kinds), loc="outside lower center", ncols=4)
    return figure


def panels_of(diagnosis: Diagnosis) -> list[FitRow]:
    """Return the pairs of action and fluent that are drawn, in their order."""
    wrong = [fit for fit in diagnosis.fits if fit.cost > 0.0]
    moving = sorted(diagnosis.fits, key=lambda fit: -fit.change / (fit.scale or 1.0))
    return (wrong or [fit for fit in moving if fit.change > 0.0])[:PANELS]


def _draw(axes: Axes, diagnosis: Diagnosis, fit: FitRow, action: int, column: int) -> str:
    """Draw one panel; return its kind, `table` or `points`."""
    steps, rows = diagnosis.steps, np.flatnonzero(diagnosis.sample.actions == action)
    before = steps.before[rows, column]
    observed, by_file, by_found = (
        after[rows, column] - before
        for after in (steps.after, diagnosis.predicted, diagnosis.expected)
    )
    whole = np.isfinite(by_file) & np.isfinite(by_found)
    observed, by_file, by_found = observed[whole], by_file[whole], by_found[whole]
    fluents = diagnosis.recorded.model.fluents
    numeric = fluents[column].numeric if column < len(fluents) else fit.fluent == REWARD
    axes.set_title(f"{_short(fit.action)}: {_short(fit.fluent)}", pad=18)
    axes.text(
        0.0, 1.02, f"error {number(fit.rmse_written)} → {number(fit.rmse_found)}",
        transform=axes.transAxes, fontsize=8, color=FAINT, verticalalignment="bottom",
    )  # fmt: skip
    seen, said = _distinct(observed), _distinct(by_file)
    if len(seen) <= _VALUES and len(said) <= _VALUES and (not numeric or _counts(seen)):
        _draw_table(axes, observed, by_file, np.union1d(seen, said), numeric)
        return "table"
    _draw_points(axes, observed, by_file, by_found)
    return "points"


def _draw_points(axes: Axes, observed: Vector, written: Vector, found: Vector) -> None:
    few = np.unique(np.linspace(0, len(observed) - 1, min(_POINTS, len(observed))).astype(int))
    for predicted, colour in ((written, _WRITTEN), (found, _FOUND)):
        axes.scatter(
            predicted[few], observed[few], s=7, color=colour, alpha=0.45, linewidths=0,
            rasterized=True,
        )  # fmt: skip
    values = np.concatenate((observed, written, found))
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 1.0
    ends = low - margin, high + margin
    axes.plot(ends, ends, color=INK, linewidth=0.8, zorder=0.5)
    axes.set_xlim(*ends)
    axes.set_ylim(*ends)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))


def _draw_table(
    axes: Axes, observed: Vector, written: Vector, values: Vector, numeric: bool
) -> None:
    """Draw the frequencies of the observed changes for each predicted change."""
    said = [value for value in values if (_rounded(written) == value).any()]
    shares = np.zeros((len(values), len(said)))
    for k, value in enumerate(said):
        here = _rounded(observed)[_rounded(written) == value]
        shares[:, k] = [np.mean(here == other) for other in values]
    axes.imshow(shares, cmap="Greys", vmin=0.0, vmax=2.2, aspect="auto", origin="lower")
    for row, value in enumerate(values):
        for k, predicted in enumerate(said):
            if shares[row, k] > 0:
                axes.text(
                    k, row, f"{100 * shares[row, k]:.0f} %", fontsize=9,
                    horizontalalignment="center", verticalalignment="center",
                    color=_WRITTEN if value != predicted else INK,
                )  # fmt: skip
    axes.set_xticks(range(len(said)), [_change(value, numeric) for value in said])
    axes.set_yticks(range(len(values)), [_change(value, numeric) for value in values])
    axes.grid(False)


def _legend(kinds: Collection[str]) -> list[Line2D]:
    def mark(marker: str, colour: str, label: str) -> Line2D:
        return Line2D([], [], color=colour, marker=marker, linestyle="", markersize=5, label=label)

    handles = []
    if "points" in kinds:
        handles += [
            mark("o", _WRITTEN, "file as written"),
            mark("o", _FOUND, "with what was found"),
            Line2D([], [], color=INK, linewidth=0.8, label="where both are equal"),
        ]
    if "table" in kinds:
        handles.append(mark("s", _WRITTEN, "fraction of the steps with another change"))
    return handles


def _rounded(values: Vector) -> NDArray[Any]:
    return np.round(values, 6) + 0.0


def _distinct(values: Vector) -> Vector:
    return np.unique(_rounded(values))


def _counts(values: Vector) -> bool:
    """Return whether changes resemble those of a counter or of a position on a grid."""
    return bool(np.all(values == np.round(values))) and len(values) > 1


def _change(value: float, numeric: bool) -> str:
    if numeric:
        return "0" if value == 0 else f"{'+' if value > 0 else '−'}{number(abs(value))}"
    return "stays" if value == 0 else ("true" if value > 0 else "false")


def _short(name: str) -> str:
    return name if len(name) <= _NAME else name[: _NAME - 1] + "…"
