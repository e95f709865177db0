"""Draw the table of `tests/benchmarks/study_hand_over.py`, and print its end as Markdown.

    python docs/drawings/hand_over.py docs/results/hand-over.csv docs/images/hand-over.svg
    python docs/drawings/hand_over.py docs/results/hand-over-variants.csv

A panel is a task. Returns of `dqn` that are far below the others leave it at the bottom.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from serp._util.figures import ACTORS, INK, LINE, STYLE, render

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = Mapping[str, str]
CURVES: Final[Mapping[str, Mapping[str, Any]]] = {
    "serp": {"color": INK, "linewidth": 6.0, "alpha": 0.35},
    "dqn": {"color": LINE, "linewidth": 1.5, "linestyle": "--"},
    "planner": {"color": ACTORS["planner"], "linewidth": 2.0},
    "learner": {"color": ACTORS["learner"], "linewidth": 2.0},
}
"""Column → its curve. The policy `serp` lies behind the two that it is made of."""
COLUMNS: Final = 4


def estimate(cell: str) -> tuple[float, float] | None:
    """Return mean and half width of `3.6 ± 0.7 (3.1)`; None of an empty cell."""
    found = re.match(r"(\S+) ± (\S+)", cell)
    return None if found is None else (float(found[1]), float(found[2]))


def panel(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw what the policies of a task are worth as training goes."""
    own: list[float] = []
    for name, style in CURVES.items():
        points = [(int(row["env steps"].replace(",", "")), estimate(row[name])) for row in rows]
        known = [(steps, *value) for steps, value in points if value is not None]
        if not known:
            continue
        steps, means, halves = zip(*known, strict=True)
        if name == "serp":
            low = [mean - half for mean, half in zip(means, halves, strict=True)]
            high = [mean + half for mean, half in zip(means, halves, strict=True)]
            axes.fill_between(steps, low, high, color=INK, alpha=0.1, linewidth=0)
        own += means if name != "dqn" else ()
        axes.plot(steps, means, label=name, **style)
    margin = 0.12 * (max(own) - min(own)) or 1.0
    axes.set_ylim(min(own) - margin, max(own) + margin)
    axes.set_xscale("log")
    axes.set_xticks([500, 2000, 10000], ["500", "2,000", "10,000"])
    axes.minorticks_off()
    axes.locator_params(axis="y", nbins=4)
    axes.set_title(rows[0]["task"], fontsize=11)


def draw(rows: Sequence[Row]) -> bytes:
    """Return the picture: a panel for each task, and in the last cell what the curves are."""
    import matplotlib.pyplot as plt

    tasks = list(dict.fromkeys(row["task"] for row in rows))
    with plt.style.context(["default", STYLE | {"font.size": 9}]):
        figure, grid = plt.subplots(
            -(-(len(tasks) + 1) // COLUMNS), COLUMNS, figsize=(10, 9.2), layout="constrained"
        )
        for task, axes in zip(tasks, grid.flat, strict=False):
            panel(axes, [row for row in rows if row["task"] == task])
        for axes in list(grid.flat)[len(tasks) :]:
            axes.set_axis_off()
        handles, names = grid.flat[0].get_legend_handles_labels()
        grid.flat[len(tasks)].legend(
            handles, names, loc="center left", title="mean return over env steps", fontsize=11
        )
        return render(figure, "svg")


def rounded(cell: str) -> str:
    """Return mean and half width with as many digits as a reader wants."""
    value = estimate(cell)
    if value is None:
        return cell
    mean, half = value
    return f"{mean:.3g} ± {0 if half < 1e-9 else float(f'{half:.2g}'):g}".replace("-", "−")


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a Markdown table: what is reached at the last point."""
    last = rows[-1]["env steps"]
    names = [name for name in ("planner", "learner", "serp", "dqn", "training") if name in rows[0]]
    yield f"| task | {' | '.join(names)} |"
    yield "|---|" + "--:|" * len(names)
    for row in rows:
        if row["env steps"] == last:
            cells = [rounded(row[name]) for name in names]
            yield f"| {' | '.join([row['task'], *cells])} |"


if __name__ == "__main__":
    with Path(sys.argv[1]).open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    for picture in sys.argv[2:]:
        Path(picture).write_bytes(draw(found))
    print("\n".join(summary(found)))
