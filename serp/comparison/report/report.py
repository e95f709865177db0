"""The report of a comparison: a self-contained page, its figures and all its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from serp._util.figures import render
from serp._util.files import cannot_write, make_inside, write_durably
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import RESAMPLES
from serp.comparison.analysis.variants import subject, variant_rows
from serp.comparison.report import tables
from serp.comparison.report.export import (
    comparison_json,
    episodes_csv,
    evaluations_csv,
    measures_csv,
)
from serp.comparison.report.figures import Picture, pictures
from serp.comparison.report.formatting import NOTHING, seeds_text
from serp.comparison.report.rendering import html_page, rendered
from serp.runs.summary import WINDOW

_FIGURES: Final = "figures"


def write_report(folder: Path, results: Results) -> None:
    """Write the report of a comparison, finished or not.

    `report.md` and `report.html` (which embeds its figures), `figures/*.png` and `*.svg`,
    `measures.csv`, `episodes.csv`, `evaluations.csv`, `comparison.json`. Equal results give equal
    files on equal machines. Files of an earlier report are replaced.
    """
    drawn = pictures(results)
    markdown = report_text(results, drawn)
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
        "episodes.csv": episodes_csv(results.records),
        "evaluations.csv": evaluations_csv(results.records),
        "comparison.json": comparison_json(results),
        **images,
    }
    for name, content in files.items():
        write_durably(folder / name, content)


def report_text(results: Results, drawn: Sequence[Picture]) -> str:
    """Return the report as Markdown, which names its figures as `figures/<name>.svg`."""
    return rendered(
        "report.md.j2",
        results=results,
        metadata=results.metadata,
        plan=results.plan,
        protocol=results.plan.protocol,
        pictures={picture.name: picture for picture in drawn},
        missing=[*map(str, results.missing)],
        seeds=seeds_text(results.plan.seeds),
        nothing=NOTHING,
        window=WINDOW,
        resamples=RESAMPLES,
        subject=subject(results),
        variants=variant_rows(results),
        tables=tables,
    )
