"""The style of all diagrams, and their files: equal data give equal bytes.

Planner, learner, exploration and fallback have the same colours in curves and in films. They are
from Okabe and Ito's palette, which colour-blind readers can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK: Final = "#222222"
FAINT: Final = "#8A8F98"
PLANNER: Final = "#0072B2"
REFUSED: Final = "#B5271B"
"""Colour of refused and unsafe actions, as in a planning graph."""
ACTORS: Final[Mapping[str, str]] = {
    "planner": PLANNER,
    "learner": "#E69F00",
    "exploration": "#009E73",
    "fallback": FAINT,
}
"""Values of `serp.control.arbiter.Actor` → colour."""

STYLE: Final[dict[str, Any]] = {
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "font.family": "DejaVu Sans",  # shipped with matplotlib: the same everywhere
    "font.size": 11,
    "axes.titlesize": 13,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#E4E7EB",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "svg.hashsalt": "serp",  # names of clip paths are random without it
    "svg.fonttype": "path",
    "text.parse_math": False,  # names may contain dollar signs
}


def render(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """Return the bytes of a picture file, without a date: equal runs give equal files."""
    import matplotlib.style

    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
    with matplotlib.style.context(["default", STYLE]):
        figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()


def legend_above(axes: Axes, columns: int) -> None:
    """Draw a legend over the top edge, clear of all data."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.6,
    )
