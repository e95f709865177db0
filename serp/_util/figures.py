"""How all diagrams look, and the bytes of their files: the same for the same data."""

from __future__ import annotations

import io
from typing import Any, Final, Literal

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK: Final = "#222222"
FAINT: Final = "#8A8F98"

STYLE: Final[dict[str, Any]] = {
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
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
    "svg.hashsalt": "serp",  # names of clip paths: random without it
    "svg.fonttype": "path",
    "text.parse_math": False,  # a name with dollar signs is a name
}


def render(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """The bytes of a picture file, without a date, so that equal runs give equal files."""
    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
    with matplotlib.style.context(["default", STYLE]):
        figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()


def legend_above(axes: Axes, columns: int) -> None:
    """A legend over the top edge, clear of all data."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.6,
    )
