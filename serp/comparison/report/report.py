"""The report of a comparison: a self-contained page, its figures and all its numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from serp._util.figures import render
from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.markdown import plain
from serp._util.number_format import percent
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import RESAMPLES
from serp.comparison.analysis.variants import EARLY_MARGIN, FINAL_MARGIN, subject, variant_rows
from serp.comparison.report import tables
from serp.comparison.report.export import (
    comparison_json,
    episodes_csv,
    evaluations_csv,
    measures_csv,
)
from serp.comparison.report.figures import Picture, pictures
from serp.comparison.report.formatting import NOTHING, number, seeds_text
from serp.comparison.report.rendering import html_page, rendered
from serp.comparison.trial_records import Trial
from serp.runs.summary import WINDOW

_FIGURES: Final = "figures"
_MOST_NAMED: Final = 40


def write_report(folder: Path, results: Results) -> None:
    """Write the report of a comparison, finished or not.

    `report.md` and `report.html` (which embeds its figures), `figures/*.png` and `*.svg`,
    `measures.csv`, `episodes.csv`, `evaluations.csv`, `comparison.json`. Equal results give equal
    files on equal machines. Files of an earlier report are replaced.

    Args:
        folder: An existing folder.
        results: The finished trials; some, or all, may be missing.

    Raises:
        RunError: A file cannot be written.
    """
    drawn = pictures(results)
    markdown = report_text(results, drawn)
    try:
        make_inside(folder, _FIGURES)
    except OSError as error:
        raise cannot_write(folder / _FIGURES, error, "No report was written.") from error
    vectors = {f"{_FIGURES}/{picture.name}.svg": render(picture.figure, "svg") for picture in drawn}
    files: dict[str, bytes | str] = {
        "report.md": markdown,
        "report.html": html_page(markdown, f"Comparison: {results.metadata.task}", vectors),
        "measures.csv": measures_csv(results),
        "episodes.csv": episodes_csv(results.records),
        "evaluations.csv": evaluations_csv(results.records),
        "comparison.json": comparison_json(results),
        **vectors,
        **{f"{_FIGURES}/{picture.name}.png": render(picture.figure, "png") for picture in drawn},
    }
    for name, content in files.items():
        write_durably(folder / name, content)


def report_text(results: Results, drawn: Sequence[Picture]) -> str:
    """Return the report as Markdown, which names its figures as `figures/<name>.svg`."""
    same, different = tables.characteristics_tables(results)
    safety = (*tables.SAFETY, *tables.task_measures(results))
    return rendered(
        "report.md.j2",
        results=results,
        metadata=results.metadata,
        pictures={picture.name: picture for picture in drawn},
        missing=_named(results.missing),
        mixed=list(_with_mixed_settings(results)),
        nothing=NOTHING,
        window=WINDOW,
        resamples=RESAMPLES,
        subject=subject(results),
        limits={
            "final": _limit(results, FINAL_MARGIN),
            "early": _limit(results, EARLY_MARGIN),
            "early_share": percent(EARLY_MARGIN),
        },
        tables={
            "overview": tables.overview_table(results),
            "protocol": tables.protocol_table(results.metadata),
            "same": same,
            "different": different,
            "returns": tables.values_table(results, tables.RETURNS),
            "thresholds": tables.thresholds_table(results),
            "safety": tables.values_table(results, safety, medians=True),
            "cost": tables.values_table(results, tables.COST),
            "differences": tables.differences_table(results),
            "variants": tables.variants_table(results) if len(variant_rows(results)) > 1 else "",
            "definitions": tables.definitions_table(results.table),
        },
    )


def _named(trials: Sequence[Trial]) -> str:
    """Return trials by algorithm and variant with their seeds, in Markdown."""
    groups: dict[tuple[str, str], list[int]] = {}
    for trial in trials:
        groups.setdefault((trial.algorithm, trial.variant), []).append(trial.seed)
    named = [
        f"{plain(algorithm)} on {plain(variant)} (seed{'s' * (len(seeds) > 1)} {seeds_text(seeds)})"
        for (algorithm, variant), seeds in groups.items()
    ]
    rest = len(named) - _MOST_NAMED
    return "; ".join(named[:_MOST_NAMED]) + (f"; and {rest} more" if rest > 0 else "")


def _with_mixed_settings(results: Results) -> Iterator[str]:
    """Yield the algorithms whose trials were not all made with the same settings."""
    for algorithm in results.algorithms:
        settings = (record.metadata.get("settings") for record in results.of(algorithm))
        if len({json.dumps(found, sort_keys=True) for found in settings}) > 1:
            yield algorithm


def _limit(results: Results, share: float) -> str:
    return f"{number(-share * results.range)} ({percent(share)} of the range of returns)"
