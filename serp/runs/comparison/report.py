"""The report of a comparison: a self-contained page, its figures, and its numbers for programs."""

from __future__ import annotations

import csv
import io
import math
import shlex
import sys
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import INK, LINE, PALETTE, STYLE, legend, page_colours, render
from serp._util.files import make_inside, write_durably
from serp._util.templates import render as render_template
from serp._util.terminal import visible
from serp._util.text import readable
from serp.runs.comparison.algorithms import PLANNER, given
from serp.runs.comparison.statistics import (
    RESAMPLES,
    Curves,
    Estimate,
    Measure,
    Results,
    evaluation_curves,
    training_curves,
)
from serp.runs.comparison.trial import Job, Trial
from serp.runs.run_config import machine
from serp.runs.summary import WINDOW

NOTHING: Final = "–"
Content = tuple[list[str], list[list[str]]]
"""A table: titles of columns, and rows; plain text."""


def write_report(folder: Path, results: Results, jobs: Sequence[Job]) -> None:
    """Write the report of a comparison, complete or not.

    `report.html` (which embeds its figures), `figures/*.png` and `*.svg`, `measures.csv`, and
    `overview.tex`. Files of an earlier report are replaced.
    """
    make_inside(folder, "figures")
    files: dict[str, bytes | str] = {
        "measures.csv": measures_csv(results),
        "overview.tex": latex(overview(results)),
    }
    embedded = {}
    for name, figure in figures(results).items():
        svg = render(figure, "svg")
        files |= {f"figures/{name}.svg": svg, f"figures/{name}.png": render(figure, "png")}
        embedded[name] = f"data:image/svg+xml;base64,{b64encode(svg).decode('ascii')}"
    files["report.html"] = render_template(
        "serp.runs.comparison",
        "report.html.j2",
        {"plain": lambda text: visible(" ".join(str(text).split())), "estimate": estimate_text},
        results=results,
        plan=results.plan,
        protocol=results.plan.protocol,
        threshold=readable(results.plan.threshold),
        colours=page_colours(),
        pictures=embedded,
        missing=[str(job.trial) for job in jobs if job.trial not in results.measured],
        count=len(jobs),
        command=shlex.join(map(str, sys.argv)),
        resamples=RESAMPLES,
        window=WINDOW,
        domains=", ".join(dict.fromkeys(Path(job.task.load().source.name).name for job in jobs)),
        machine=machine(),
        versions=_versions(results),
        algorithms={job.algorithm.name: job.algorithm for job in jobs}.values(),
        overview=overview(results),
        values=partial(values_table, results),
        definitions=[[m.name, m.meaning, m.better or NOTHING] for m in results.measures],
    )
    for name, content in files.items():
        write_durably(folder / name, content)


def _versions(results: Results) -> str:
    """Return every package with the versions that trials were made with."""
    made: dict[str, dict[str, None]] = {}
    for record in results.records:
        for name, version in record.versions.items():
            made.setdefault(name, {})[version or "not installed"] = None
    return ", ".join(f"{name} {' and '.join(versions)}" for name, versions in made.items())


def estimate_text(found: Estimate) -> str:
    """Return a value with its interval, if it has one, such as `482.1 [471, 495.2]`."""
    if math.isnan(found.value):
        return NOTHING
    ends = "" if found.low is None else f" [{readable(found.low)}, {readable(found.high)}]"
    return readable(found.value) + ends


def _cell(results: Results, algorithm: str, name: str) -> str:
    """Return a measure with its interval, and how often a threshold was never reached."""
    text = estimate_text(results.estimate(name, algorithm))
    values = results.values(algorithm, name)
    never = int(np.isposinf(values).sum())
    return f"{text}, never in {never} of {len(values)}" if never else text


def overview(results: Results) -> Content:
    """Return the main results: a row an algorithm."""
    names = ["training_area", "final_learner", "final_policy", "threshold_env_steps", "unsafe"]
    if results.plan.threshold is None:
        names.remove("threshold_env_steps")
    measures = [m for name in names for m in results.measures if m.name == name]
    (first, *head), rows = _measured(results, measures)
    told = [[name, given(name), *cells] for name, *cells in rows]
    return [first, "also uses", *head], told


def latex(content: Content) -> str:
    """Return a table for LaTeX, with the package booktabs."""
    special = {c: f"\\{c}" for c in "&%$#_{}"} | {"−": "$-$", "–": "--", "\\": "/"}
    head, rows = content
    lines = [
        " & ".join("".join(special.get(c, c) for c in cell) for cell in cells) + r" \\"
        for cells in (head, *rows)
    ]
    begin = rf"\begin{{tabular}}{{ll{'r' * (len(head) - 2)}}}"
    return "\n".join([
        begin, r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule", r"\end{tabular}", ""
    ])  # fmt: skip


def values_table(results: Results, name: str) -> Content:
    """Return the measures of a table that an algorithm has: a row an algorithm."""
    return _measured(results, [
        measure for measure in results.measures
        if measure.table == name
        and any(len(results.known(algorithm, measure.name)) for algorithm in results.algorithms)
    ])  # fmt: skip


def _measured(results: Results, measures: Sequence[Measure]) -> Content:
    rows = [[a, *(_cell(results, a, m.name) for m in measures)] for a in results.algorithms]
    return ["algorithm", *(measure.title for measure in measures)], rows


def figures(results: Results) -> dict[str, Figure]:
    """Draw every figure for which there are data."""
    budget = results.plan.protocol.env_steps
    training = {a: training_curves(results.of(a), budget) for a in results.algorithms}
    learner = {a: evaluation_curves(results.of(a)) for a in results.algorithms}
    with matplotlib.style.context(["default", STYLE]):
        drawn = {
            "training": _curves(
                results, training, "Training return", f"training return (mean of {WINDOW} episodes)"
            ),
            "learner": _curves(
                results, learner, "The learner alone", "return of the learner alone", planner=True
            ),
        }
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _curves(
    results: Results, curves: Mapping[str, Curves], title: str, label: str, *, planner: bool = False
) -> Figure | None:
    """Return a figure of a curve with its band for each algorithm; None if there is no curve."""
    # Okabe and Ito's palette without its yellow, which does not show on white. The numbers of
    # colours and dashes share no divisor.
    colours = ("vermilion", "blue", "green", "purple", "sky", "orange", "ink")
    dashes = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
    shown = {name: curve for name, curve in curves.items() if curve.y.size}
    if not shown:
        return None
    height = max(4.6, 0.22 * len(shown) + 1.5)
    figure = Figure(figsize=(9.0, height), layout="constrained")
    axes = figure.subplots()
    for place, (name, curve) in enumerate(shown.items()):
        colour = PALETTE[colours[place % len(colours)]][0]
        centre, low, high = curve.band()
        axes.plot(
            curve.x, centre, color=colour, linestyle=dashes[place % len(dashes)], label=name,
            linewidth=1.7 if place else 2.6, marker="o" if len(curve.x) == 1 else "none",
            zorder=2 - place / 1_000,
        )  # fmt: skip
        axes.fill_between(
            curve.x, low, high, color=colour, alpha=0.16, linewidth=0, zorder=1 - place / 1_000
        )
        axes.plot(
            curve.x, curve.y.T, color=colour, linewidth=0.7, alpha=0.25, label="_seed", zorder=0.5
        )
    worth = results.known(PLANNER, "final_policy")
    if planner and len(worth):
        axes.axhline(
            worth.mean(), color=LINE, linestyle=(0, (1, 1.5)), linewidth=2.0, label="planner alone"
        )
    threshold = results.plan.threshold
    bottom, top = axes.get_ylim()
    if threshold is not None and bottom <= threshold <= top + 0.1 * (top - bottom):
        axes.axhline(threshold, color=LINE, linewidth=1.2, zorder=1.5, label="threshold")
    budget = f"{results.plan.protocol.env_steps:,} env steps"
    axes.set(xlabel="env steps", ylabel=label, title=f"{title} over {budget}")
    if results.caution is not None:
        figure.supxlabel(results.caution, fontsize=9.5, color=INK)
    axes.set_xlim(0, max(float(max(curve.x[-1] for curve in shown.values())), 2.0))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    legend(axes)
    return figure


def measures_csv(results: Results) -> str:
    """Return a row per trial, a column per measure; empty if not measured, `inf` for never."""
    names = [measure.name for measure in results.measures]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*Trial._fields, *names])
    for trial, row in results.measured.items():
        cells = (row.get(name, math.nan) for name in names)
        writer.writerow([*trial, *("" if math.isnan(cell) else cell for cell in cells)])
    return text.getvalue()
