"""The report of a comparison: a self-contained page, its figures, and its numbers for programs."""

from __future__ import annotations

import csv
import io
import json
import math
import shlex
import sys
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import INK, LINE, PALETTE, STYLE, label_ends, render
from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.templates import render as render_template
from serp._util.terminal import visible
from serp._util.text import readable
from serp.runs.comparison.algorithms import PLANNER
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
from serp.runs.run_config import machine, versions
from serp.runs.summary import WINDOW

NOTHING: Final = "–"
Content = tuple[list[str], list[list[str]]]
"""A table: titles of columns, and rows; plain text."""


def write_report(
    folder: Path,
    results: Results,
    jobs: Sequence[Job],
    notes: Sequence[str],
) -> None:
    """Write the report of a comparison, complete or not.

    `report.html` (which embeds its figures), `figures/*.png` and `*.svg`, and `measures.csv`. Files
    of an earlier report are replaced.
    """
    figures = "figures"
    drawn = pictures(results)
    try:
        make_inside(folder, figures)
    except OSError as error:
        raise cannot_write(folder / figures, error, "No report was written.") from error
    files: dict[str, bytes | str] = {
        f"{figures}/{picture.name}.{kind}": render(picture.figure, kind)
        for picture in drawn
        for kind in ("svg", "png")
    }
    embedded = {
        picture.name: (picture, _address(files[f"{figures}/{picture.name}.svg"]))
        for picture in drawn
    }
    files["report.html"] = report_page(results, jobs, notes, embedded)
    files["measures.csv"] = measures_csv(results)
    for name, content in files.items():
        write_durably(folder / name, content)


def _address(svg: str | bytes) -> str:
    data = svg.encode() if isinstance(svg, str) else svg
    return f"data:image/svg+xml;base64,{b64encode(data).decode('ascii')}"


def report_page(
    results: Results,
    jobs: Sequence[Job],
    notes: Sequence[str],
    drawn: Mapping[str, tuple[Picture, str]],
) -> str:
    """Return the report as HTML; `drawn` has the address of each figure."""
    return render_template(
        "serp.runs.comparison",
        "report.html.j2",
        {"plain": lambda text: visible(" ".join(str(text).split()))},
        results=results,
        plan=results.plan,
        palette=PALETTE,
        pictures=drawn,
        notes=notes,
        missing=[str(job.trial) for job in jobs if job.trial not in results.measured],
        count=len(jobs),
        command=shlex.join(map(str, sys.argv)),
        resamples=RESAMPLES,
        compared=compared_table(results),
        settings=settings_table(results, jobs),
        overview=overview(results),
        values=partial(values_table, results),
        differences=differences_table(results),
        definitions=(
            ["measure", "meaning", "better"],
            [[m.name, m.meaning, m.better or NOTHING] for m in results.measures],
        ),
    )


# Tables ----------------------------------------------------------------------------------------


def estimate_text(found: Estimate) -> str:
    """Return a value with its interval, if it has one, such as `482.1 [471, 495.2]`."""
    if math.isnan(found.value):
        return NOTHING
    ends = "" if found.low is None else f" [{readable(found.low)}, {readable(found.high)}]"
    return readable(found.value) + ends


def _cell(results: Results, algorithm: str, name: str) -> str:
    """Return a measure with its interval, and how often a threshold was never reached."""
    text = estimate_text(results.estimate(algorithm, name))
    values = results.values(algorithm, name)
    never = int(np.isposinf(values).sum())
    return f"{text}, never in {never} of {len(values)}" if never else text


def overview(results: Results) -> Content:
    """Return the main results: a row an algorithm."""
    names = ["training_area", "final_learner", "final_policy", "threshold_env_steps", "unsafe"]
    if results.plan.threshold is None:
        names.remove("threshold_env_steps")
    return _measured(results, [m for name in names for m in results.measures if m.name == name])


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


def differences_table(results: Results) -> Content:
    """Return the differences of interquartile means of each algorithm to the first."""
    compared = [measure for measure in results.measures if measure.compared]
    first, *others = results.algorithms or ("",)
    rows = [
        [
            f"{other} − {first}",
            *(estimate_text(results.difference(other, first, m.name)) for m in compared),
        ]
        for other in others
    ]
    return ["difference", *(m.title for m in compared)], rows


def compared_table(results: Results) -> Content:
    """Return what all trials have in common."""
    plan, protocol = results.plan, results.plan.protocol
    installed = ", ".join(f"{name} {text}" for name, text in versions().items() if text)
    rows = {
        "task": plan.task,
        "domain files, the task's own first": ", ".join(plan.domains),
        "budget": f"{protocol.env_steps:,} env steps a trial",
        "seeds": ", ".join(map(str, plan.seeds)),
        "return from which a policy counts as good (threshold)": readable(plan.threshold),
        "evaluation of the learner alone": f"{protocol.evaluation_episodes} episodes every "
        f"{protocol.evaluate_every:,} env steps; {protocol.final_episodes} at the end",
        **{name: str(text) for name, text in machine().items()},
        "versions": installed,
    }
    return ["", ""], [[*row] for row in rows.items()]


def settings_table(results: Results, jobs: Sequence[Job]) -> Content:
    """Return what the algorithms are, and the settings that are not the same for all of them."""
    texts: dict[str, dict[str, str]] = {name: {} for name in results.algorithms}
    for job in jobs:
        if job.trial.algorithm not in texts:
            continue
        own = texts[job.trial.algorithm] = {"algorithm": job.algorithm.description}
        if job.algorithm.make_external is None:
            for section, values in job.settings.as_dict().items():
                own |= {
                    f"{section}.{name}": value if isinstance(value, str) else json.dumps(value)
                    for name, value in values.items()
                }
    # External algorithms have no settings of ours, so these are compared among the others.
    rows = [
        [key, *(text.get(key, NOTHING) for text in texts.values())]
        for key in dict.fromkeys(key for text in texts.values() for key in text)
        if "." not in key or len({text[key] for text in texts.values() if key in text}) > 1
    ]
    return ["what", *texts], rows


# Figures ---------------------------------------------------------------------------------------

# Okabe and Ito's palette, told apart by colour-blind readers too, without its yellow, which does
# not show on white. The numbers of colours and dashes share no divisor.


class Picture(NamedTuple):
    """A figure of the report: the name of its files, what it shows, and how to read it."""

    name: str
    title: str
    caption: str
    figure: Figure


def _colour(place: int) -> str:
    colours = ("vermilion", "blue", "green", "purple", "sky", "orange", "ink")
    return PALETTE[colours[place % len(colours)]][0]


def pictures(results: Results) -> list[Picture]:
    """Draw every figure for which there are data, in the order of the report."""
    protocol, read = results.plan.protocol, (
        "Interquartile mean over the seeds, shaded: 95 % bootstrap interval; faint: each seed."
    )  # fmt: skip
    steps = f"over {protocol.env_steps:,} env steps"
    training = {a: training_curves(results.of(a), protocol.env_steps) for a in results.algorithms}
    learner = {a: evaluation_curves(results.of(a)) for a in results.algorithms}
    with matplotlib.style.context(["default", STYLE]):
        drawn = [
            Picture("training", f"Training return {steps}",
                    f"Mean of the running episode and the {WINDOW - 1} before it. {read}",
                    _curves(results, training, f"training return (mean of {WINDOW} episodes)")),
            Picture("learner", f"The learner alone {steps}",
                    f"Mean return of {protocol.evaluation_episodes} episodes of the greedy learner "
                    f"without planner and vetoes. {read} Grey: the planner alone.",
                    _curves(results, learner, "return of the learner alone", planner=True)),
        ]  # fmt: skip
        drawn = [picture for picture in drawn if picture.figure.axes]
        for picture in drawn:
            picture.figure.axes[0].set_title(picture.title)
            if results.caution is not None:
                picture.figure.supxlabel(results.caution, fontsize=9.5, color=INK)
    return drawn


def _curves(
    results: Results, curves: Mapping[str, Curves], label: str, *, planner: bool = False
) -> Figure:
    """Return a figure of a curve with its band for each algorithm; no axes if there is no curve."""
    dashes = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
    shown = {name: curve for name, curve in curves.items() if curve.y.size}
    height = max(4.6, 0.22 * len(shown) + 1.5)
    figure = Figure(figsize=(9.0, height), layout="constrained")
    if not shown:
        return figure
    axes = figure.subplots()
    ends = []
    for place, (name, curve) in enumerate(shown.items()):
        colour, (centre, low, high) = _colour(place), curve.band()
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
        ends.append((name, float(centre[-1]), colour))
    worth = results.known(PLANNER, "final_policy")
    if planner and len(worth):
        axes.axhline(worth.mean(), color=LINE, linestyle=(0, (1, 1.5)), linewidth=2.0)
        ends.append(("planner alone", float(worth.mean()), LINE))
    threshold = results.plan.threshold
    bottom, top = axes.get_ylim()
    if threshold is not None and bottom <= threshold <= top + 0.1 * (top - bottom):
        axes.axhline(threshold, color=LINE, linewidth=1.2, zorder=1.5)
        ends.append(("threshold", threshold, LINE))
    axes.set(xlabel="env steps", ylabel=label)
    axes.set_xlim(0, max(float(max(curve.x[-1] for curve in shown.values())), 2.0))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    label_ends(axes, ends, height - 1.2)
    return figure


# Numbers for programs --------------------------------------------------------------------------


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
