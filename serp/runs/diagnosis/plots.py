"""A picture of predicted against observed changes, a panel for each quantity."""

from __future__ import annotations

from typing import Literal

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from serp._util.figures import INK, PALETTE, PLANNER, STYLE, render
from serp._util.text import percent
from serp.runs.diagnosis.accuracy import symbols_of
from serp.runs.diagnosis.diagnosis import Diagnosis


def picture(diagnosis: Diagnosis, kind: Literal["png", "svg"]) -> bytes:
    """Draw predicted against observed changes of the at most 12 quantities with the largest errors.

    A point is a pair of changes, the larger the more steps have it. Returns the bytes of a file,
    equal for equal diagnoses.
    """
    quantities = sorted(diagnosis.quantities, key=lambda q: -q.error)[:12]
    steps = diagnosis.steps
    symbols = symbols_of(diagnosis.recorded.model)
    wide = min(4, max(1, len(quantities)))
    high = max(1, -(-len(quantities) // wide))
    with matplotlib.style.context(["default", STYLE, {"font.size": 9, "axes.titlesize": 10}]):
        figure = Figure(figsize=(max(5.6, 3.1 * wide + 0.4), 2.9 * high + 1), layout="constrained")
        for position, quantity in enumerate(quantities):
            own = symbols == quantity.name
            changes = (
                after[:, own].ravel() - steps.before[:, own].ravel()
                for after in (steps.after, steps.predicted, diagnosis.expected)
            )
            observed, written, patched = (np.round(change, 6) + 0.0 for change in changes)
            axes = figure.add_subplot(high, wide, position + 1)
            series = {
                f"file: {percent(quantity.error)}": (written, PALETTE["vermilion"][0]),
                f"with findings: {percent(quantity.error_left)}": (patched, PLANNER),
            }
            if quantity.error_left == quantity.error:
                series.popitem()
            for label, (predicted, colour) in series.items():
                fine = np.isfinite(predicted)
                few = np.flatnonzero(fine)[:: max(1, int(fine.sum()) // 600)]
                pairs = np.stack((predicted[few], observed[few]))
                (x, y), counts = np.unique(pairs, axis=1, return_counts=True)
                size = np.minimum(7.0 * counts**0.75, 300.0)
                axes.scatter(x, y, s=size, color=colour, alpha=0.45, linewidths=0, rasterized=True,
                             label=label)  # fmt: skip
            axes.axline((0.0, 0.0), slope=1.0, color=INK, linewidth=0.8, zorder=0.5)
            axes.set_title(quantity.shown[1:-1])
            axes.legend(fontsize=7)
            axes.set_xlabel("predicted change")
            axes.set_ylabel("observed change")
        count = f"{len(steps.sample):,} single steps"
        figure.suptitle(f"{diagnosis.recorded.domain.name}, {count}", fontweight="bold")
    return render(figure, kind)
