"""The style of all diagrams, and their files: equal data give equal bytes.

Planner, learner, exploration and fallback have the same colours in curves and in films. They are
from Okabe and Ito's palette, which colour-blind readers can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


PALETTE: Final[Mapping[str, tuple[str, str]]] = {
    "surface": ("#ffffff", "#14171c"),
    "ink": ("#1f2430", "#e6e9ee"),
    "faint": ("#5b6472", "#a4adba"),
    "line": ("#8a8f98", "#727a86"),
    "grid": ("#e4e7eb", "#2b313a"),
    "good": ("#0a4a94", "#74adf5"),
    "bad": ("#b5271b", "#ff8373"),
    "blue": ("#0072b2", "#4aa3df"),
    "orange": ("#e69f00", "#e8a92c"),
    "green": ("#009e73", "#2bbd93"),
    "vermilion": ("#d55e00", "#f08a45"),
    "purple": ("#cc79a7", "#dd93bc"),
    "sky": ("#56b4e9", "#7cc8f2"),
}
"""Name → colour on light and on dark. PNG files have the light ones, SVG files both.

Text has `ink` or `faint`, at a contrast of at least 5.9 on its surface.
"""

INK: Final = PALETTE["ink"][0]
FAINT: Final = PALETTE["faint"][0]
LINE: Final = PALETTE["line"][0]
PLANNER: Final = PALETTE["blue"][0]
REFUSED: Final = PALETTE["bad"][0]
"""Colour of refused and unsafe actions, as in a planning graph."""
ACTORS: Final[Mapping[str, str]] = {
    "planner": PLANNER,
    "learner": PALETTE["orange"][0],
    "exploration": PALETTE["green"][0],
    "fallback": LINE,
}
"""Values of `serp.agent.arbiter.Actor` → colour."""

STYLE: Final[dict[str, Any]] = {
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "font.family": "DejaVu Sans",  # shipped with matplotlib: the same everywhere
    "font.size": 11,
    "text.color": INK,
    "axes.titlesize": 13,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": LINE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": PALETTE["grid"][0],
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "figure.constrained_layout.h_pad": 0.12,  # inches
    "figure.constrained_layout.w_pad": 0.12,
    "svg.hashsalt": "serp",  # names of clip paths are random without it
    "svg.fonttype": "path",
    "text.parse_math": False,  # names may contain dollar signs
}


def colour(name: str) -> str:
    """Return a colour of the palette for SVG: the page's, if it sets one, or else the light one."""
    return f"var(--{name}, {PALETTE[name][0]})"


def style_sheet() -> str:
    """Return the element that makes an SVG file dark where the reader's pages are."""
    dark = ";".join(f"--{name}:{shade}" for name, (_, shade) in PALETTE.items())
    return f"<style>@media (prefers-color-scheme: dark){{svg{{{dark}}}}}</style>"


def render(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """Return the bytes of a picture file, without a date: equal runs give equal files."""
    import matplotlib.style

    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {}
    with matplotlib.style.context(["default", STYLE]):
        figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue() if kind == "png" else _both_ways(buffer.getvalue().decode())


def _both_ways(svg: str) -> bytes:
    """Return an SVG file of matplotlib with the colours of the palette, light and dark."""
    for name, (light, _) in PALETTE.items():
        svg = svg.replace(light, colour(name))
    return svg.replace("<defs>", style_sheet() + "<defs>", 1).encode()


def caption(axes: Axes, text: str) -> None:
    """Write between the title and the axes how a diagram is read."""
    axes.annotate(text, (0, 1), (0, 6), "axes fraction", "offset points", color=FAINT, fontsize=9.5)


def label_ends(axes: Axes, ends: Sequence[tuple[str, float, str]], inches: float) -> None:
    """Name curves beside their right ends, so that nobody has to look them up in a legend.

    Args:
        axes: With their final limits.
        ends: Name, height in data and colour of each curve.
        inches: Height of the axes, about: names are moved apart where they would overlap.
    """
    low, high = axes.get_ylim()
    at = sorted((min(max((y - low) / (high - low), 0.0), 1.0), name, shade)
                for name, y, shade in ends if np.isfinite(y))  # fmt: skip
    for (share, name, shade), row in zip(
        at, _apart([y for y, *_ in at], 0.2 / inches), strict=True
    ):
        axes.plot(
            [1.005, 1.02, 1.035], [share, row, row], transform=axes.transAxes, color=shade,
            linewidth=2.0, clip_on=False, label="_name",
        )  # fmt: skip
        axes.text(1.045, row, name, transform=axes.transAxes, fontsize=10, color=INK,
                  verticalalignment="center")  # fmt: skip


def _apart(heights: Sequence[float], gap: float) -> list[float]:
    """Return ascending heights moved apart to a distance, about where they were."""
    from scipy.optimize import isotonic_regression

    rows = gap * np.arange(len(heights))
    apart: list[float] = (isotonic_regression(heights - rows).x + rows).tolist()
    return apart
