"""Colour, dash and marker of each algorithm: the same in all figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from matplotlib.axis import Axis
from matplotlib.figure import Figure

from serp._util.figures import INK

# Okabe and Ito's palette, told apart by colour-blind readers too, without its yellow, which does
# not show on white. The numbers of colours, dashes and markers share no divisor, so that 140
# algorithms differ.
_COLOURS: Final = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_DASHES: Final[tuple[Any, ...]] = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_MARKERS: Final = ("o", "s", "^", "D", "v")


class LineStyle(NamedTuple):
    """The style of an algorithm in figures.

    Attributes:
        colour: Colour of line, band and marker.
        dash: Line style of matplotlib.
        marker: Marker of matplotlib.
        width: Line width in points; the first algorithm's is the largest.
    """

    colour: str
    dash: Any
    marker: str
    width: float


CUT: Final = "(axis cut)"
"""Marks an axis on which differences look larger than they are."""


def mark_cut(*axes: Axis) -> None:
    """Mark each axis that does not show 0."""
    for axis in axes:
        low, high = sorted(axis.get_view_interval())
        if not low <= 0.0 <= high:
            axis.set_label_text(f"{axis.get_label_text()} {CUT}")


def is_cut(figure: Figure) -> bool:
    """Return whether an axis of a figure is marked as cut."""
    return any(
        CUT in axis.get_label_text() for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)
    )


def mark_caution(figure: Figure, caution: str | None) -> None:
    """Write a warning below a figure with intervals."""
    if caution is not None:
        figure.supxlabel(caution, fontsize=9.5, color=INK)


def line_styles(algorithms: Sequence[str]) -> dict[str, LineStyle]:
    """Return the style of each algorithm, by its place in the comparison."""
    return {
        name: LineStyle(
            _COLOURS[i % len(_COLOURS)],
            _DASHES[i % len(_DASHES)],
            _MARKERS[i % len(_MARKERS)],
            2.6 if i == 0 else 1.7,
        )
        for i, name in enumerate(algorithms)
    }
