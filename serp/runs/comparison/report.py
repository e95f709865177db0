"""The report of a comparison: a self-contained page, its figures, and its numbers for programs."""

from __future__ import annotations

import csv
import io
import json
import math
import shlex
import sys
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib.style
import numpy as np
from markdown_it import MarkdownIt
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from serp._util.figures import INK, LINE, PALETTE, STYLE, label_ends, render
from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.templates import render as render_template
from serp._util.terminal import visible
from serp._util.text import code, markdown_text, readable, table
from serp.runs.comparison.algorithms import PLANNER
from serp.runs.comparison.statistics import (
    RESAMPLES,
    Curves,
    Estimate,
    Results,
    evaluation_curves,
    training_curves,
)
from serp.runs.comparison.trial import Job, Trial
from serp.runs.folder import machine, versions
from serp.runs.summary import WINDOW

NOTHING: Final = "–"
_FIGURES: Final = "figures"


def write_report(
    folder: Path,
    results: Results,
    jobs: Sequence[Job],
    notes: Sequence[str],
) -> None:
    """Write the report of a comparison, complete or not.

    `report.md` and `report.html` (which embeds its figures), `figures/*.png` and `*.svg`, and
    `measures.csv`. Files of an earlier report are replaced.
    """
    drawn = pictures(results)
    markdown = report_text(results, jobs, notes, drawn)
    try:
        make_inside(folder, _FIGURES)
    except OSError as error:
        raise cannot_write(folder / _FIGURES, error, "No report was written.") from error
    images = {
        f"{_FIGURES}/{picture.name}.{kind}": render(picture.figure, kind)
        for picture in drawn
        for kind in ("svg", "png")
    }
    files: dict[str, bytes | str] = {
        "report.md": markdown,
        "report.html": html_page(markdown, f"Comparison: {results.plan.task}", images),
        "measures.csv": measures_csv(results),
        **images,
    }
    for name, content in files.items():
        write_durably(folder / name, content)


# Pages -----------------------------------------------------------------------------------------


def report_text(
    results: Results,
    jobs: Sequence[Job],
    notes: Sequence[str],
    drawn: Sequence[Picture],
) -> str:
    """Return the report as Markdown, which names its figures as `figures/<name>.svg`."""
    return render_template(
        "serp.runs.comparison",
        "report.md.j2",
        {"plain": markdown_text, "code": code, "number": readable},
        results=results,
        plan=results.plan,
        protocol=results.plan.protocol,
        pictures={picture.name: picture for picture in drawn},
        notes=notes,
        missing=[str(job.trial) for job in jobs if job.trial not in results.measured],
        count=len(jobs),
        machine=machine(),
        versions=versions(),
        command=shlex.join(map(str, sys.argv)),
        window=WINDOW,
        resamples=RESAMPLES,
        settings=settings_table(results, jobs),
        overview=table(*_in_markdown(*overview(results))),
        values=partial(values_table, results),
        differences=differences_table(results),
    )


def html_page(markdown: str, title: str, pictures: Mapping[str, bytes]) -> str:
    """Return Markdown as an HTML document; it embeds `pictures` (address → SVG), HTML is shown."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(markdown)
    for token in tokens:
        for part in token.children or ():
            source = str(part.attrGet("src") or "")
            if part.type == "image" and source in pictures:
                embedded = b64encode(pictures[source]).decode("ascii")
                part.attrSet("src", f"data:image/svg+xml;base64,{embedded}")
    body = reader.renderer.render(tokens, reader.options, {})
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return render_template(
        "serp.runs.comparison", "page.html.j2", title=visible(title), body=body, palette=PALETTE
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


def overview(results: Results) -> tuple[list[str], list[list[str]]]:
    """Return the main results: titles of columns, and a row an algorithm; plain text."""
    names = ["training_area", "final_learner", "final_policy", "threshold_env_steps", "unsafe"]
    if results.plan.threshold is None:
        names.remove("threshold_env_steps")
    titles = {measure.name: measure.title for measure in results.measures}
    rows = [[a, *(_cell(results, a, name) for name in names)] for a in results.algorithms]
    return ["algorithm", *(titles[name] for name in names)], rows


def _in_markdown(
    head: Sequence[str], rows: Iterable[Sequence[str]]
) -> tuple[list[str], list[list[str]]]:
    return [*map(markdown_text, head)], [[markdown_text(row[0]), *row[1:]] for row in rows]


def values_table(results: Results, name: str) -> str:
    """Return the measures of a table: a row an algorithm, interquartile means with intervals.

    Measures that no algorithm has are left out; the text is empty if none is left.
    """
    shown = [
        measure for measure in results.measures
        if measure.table == name
        and any(len(results.known(algorithm, measure.name)) for algorithm in results.algorithms)
    ]  # fmt: skip
    rows = [[a, *(_cell(results, a, m.name) for m in shown)] for a in results.algorithms]
    head = ["algorithm", *(measure.title for measure in shown)]
    return table(*_in_markdown(head, rows)) if shown else ""


def differences_table(results: Results) -> str:
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
    return table(*_in_markdown(["difference", *(m.title for m in compared)], rows))


def settings_table(results: Results, jobs: Sequence[Job]) -> str:
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
    rows = []
    for key in dict.fromkeys(key for text in texts.values() for key in text):
        # External algorithms have no settings of ours, so these are compared among the others.
        if "." not in key or len({text[key] for text in texts.values() if key in text}) > 1:
            cells = (text.get(key, NOTHING) for text in texts.values())
            rows.append([*map(markdown_text, (key, *cells))])
    return table(["what", *map(markdown_text, texts)], rows, left=len(texts) + 1)


# Figures ---------------------------------------------------------------------------------------

# Okabe and Ito's palette, told apart by colour-blind readers too, without its yellow, which does
# not show on white. The numbers of colours and dashes share no divisor.
_COLOURS: Final = ("vermilion", "blue", "green", "purple", "sky", "orange", "ink")
_DASHES: Final[tuple[Any, ...]] = ("-", (0, (5, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))


class Picture(NamedTuple):
    """A figure of the report: the name of its files, what it shows, and how to read it."""

    name: str
    title: str
    caption: str
    figure: Figure


def _colour(place: int) -> str:
    return PALETTE[_COLOURS[place % len(_COLOURS)]][0]


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
            curve.x, centre, color=colour, linestyle=_DASHES[place % len(_DASHES)], label=name,
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
