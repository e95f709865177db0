"""Which colour, dash and marker an algorithm has: the same in all figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

# Okabe and Ito's palette, told apart by colour-blind readers too, without its yellow, which does
# not show on white. The numbers of colours, dashes and markers share no divisor, so that 140
# algorithms differ.
_COLOURS: Final = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_DASHES: Final[tuple[Any, ...]] = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_MARKERS: Final = ("o", "s", "^", "D", "v")


class Look(NamedTuple):
    """How an algorithm is drawn.

    Attributes:
        colour: Of line, band and marker.
        dash: Style of its line, as matplotlib takes it.
        marker: Of its points.
        width: Of its line, in points: the first algorithm's is the widest.
    """

    colour: str
    dash: Any
    marker: str
    width: float


def looks(algorithms: Sequence[str]) -> dict[str, Look]:
    """A look for each algorithm, by its place in the comparison."""
    return {
        name: Look(
            _COLOURS[i % len(_COLOURS)],
            _DASHES[i % len(_DASHES)],
            _MARKERS[i % len(_MARKERS)],
            2.6 if i == 0 else 1.7,
        )
        for i, name in enumerate(algorithms)
    }
