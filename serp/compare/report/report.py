"""The report of a comparison: one page that can be read alone, its figures, and all its numbers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from serp._util.figures import render
from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.markdown import code, plain, table
from serp._util.numbers import percent
from serp.compare.analysis.results import Results
from serp.compare.analysis.statistics import RESAMPLES
from serp.compare.analysis.variants import EARLY_MARGIN, FINAL_MARGIN, subject, variant_rows
from serp.compare.records import Record, Trial
from serp.compare.report.export import comparison_json, episodes_csv, evaluations_csv, measures_csv
from serp.compare.report.figures import Picture, pictures
from serp.compare.report.markdown import NOTHING, estimate_text, number, times_text
from serp.compare.report.metadata import ComparisonAbout as ComparisonAbout
from serp.compare.report.page import page
from serp.compare.report.tables import (
    COST,
    RETURNS,
    SAFETY,
    definitions_table,
    differences_table,
    task_measures,
    terms_tables,
    thresholds_table,
    values_table,
    variants_table,
)
from serp.runs.summary import WINDOW

FIGURES: Final = "figures"
_MOST_NAMED: Final = 40


class ReportFiles(NamedTuple):
    """What `write_report` has written.

    Attributes:
        files: All files, the report first.
        results: The trials and their measures.
    """

    files: tuple[Path, ...]
    results: Results


def write_report(folder: Path, records: Sequence[Record], about: ComparisonAbout) -> ReportFiles:
    """Write the report of a comparison, finished or not.

    `report.md` and `report.html` (which holds its figures), `figures/*.png` and `*.svg`,
    `measures.csv`, `episodes.csv`, `evaluations.csv`, `comparison.json`. Equal records give equal
    files on equal machines. Files of an earlier report are replaced.

    Args:
        folder: An existing folder.
        records: Of the finished trials; some, or all, may be missing.
        about: What the comparison was asked for.

    Raises:
        RunError: A file cannot be written.
    """
    results = Results(records, about)
    drawn = pictures(results)
    markdown = report_text(results, drawn)
    try:
        make_inside(folder, FIGURES)
    except OSError as error:
        raise cannot_write(folder / FIGURES, error, "No report was written.") from error
    vectors = {f"{FIGURES}/{picture.name}.svg": render(picture.figure, "svg") for picture in drawn}
    files: dict[str, bytes | str] = {
        "report.md": markdown,
        "report.html": page(markdown, f"Comparison: {about.task}", vectors),
        "measures.csv": measures_csv(results),
        "episodes.csv": episodes_csv(results.records),
        "evaluations.csv": evaluations_csv(results.records),
        "comparison.json": comparison_json(results),
        **vectors,
        **{f"{FIGURES}/{picture.name}.png": render(picture.figure, "png") for picture in drawn},
    }
    for name, content in files.items():
        write_durably(folder / name, content)
    return ReportFiles(tuple(folder / name for name in files), results)


def report_text(results: Results, drawn: Sequence[Picture]) -> str:
    """The report as Markdown, with its figures as `figures/<name>.svg`."""
    figures = {picture.name: _figure(picture) for picture in drawn}
    about = results.about
    sections = [f"# Comparison: {plain(about.task)}", *_state(results)]
    if results.algorithms:
        sections += [_lead(results), figures.get("training-paper", "")]
    sections += ["## What was compared", _what(results)]
    if results.algorithms:
        sections += [*_equal_terms(results), *_results(results, figures)]
    if len(variant_rows(results)) > 1:
        sections += _variants(results, figures)
    sections += [
        "## How to reproduce",
        code(about.command),
        "Trials that are finished are not run again; what is missing is.",
        "## Definitions",
        _DEFINITIONS.format(resamples=RESAMPLES, range=number(results.range)),
        definitions_table(results.table),
        "## Files",
        _FILES,
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


_DEFINITIONS: Final = """\
* **IQM**: interquartile mean over the seeds, the mean of the middle half.
* **[95 %]**: 95 % percentile interval of a bootstrap over the seeds with {resamples:,} resamples, \
stratified where several domain files are pooled (Agarwal et al. 2021, arXiv:2108.13264). There is \
none for a single seed. Differences resample both sides independently.
* **± std**: standard deviation over the seeds (n − 1).
* **Times**: medians over all trials with the 95 % interval of the median. Where means or \
differences of times to the threshold are given, never counts as the whole training. A trial with \
too few episodes to tell whether the threshold was reached counts nowhere.
* **Range**: the largest less the smallest return of any episode in this comparison, here {range}.
* **Training return** includes exploration and, where there is one, the planner's actions. \
**The learner alone** acts greedily, without planner and vetoes."""

_FILES: Final = """\
* `report.html`: this report with its figures in one file
* `figures/`: every figure as PNG and SVG
* `measures.csv`: all measures, a row a trial (empty: not measured, or too few episodes to tell; \
inf: never)
* `episodes.csv`, `evaluations.csv`: every episode of training and of evaluation
* `comparison.json`: all of it for programs"""


def _state(results: Results) -> Iterable[str]:
    """What a reader has to know first: notes, and what is missing."""
    about = results.about
    if about.notes:
        yield "\n".join(f"* {plain(note)}" for note in about.notes)
    if results.missing:
        done = len(about.trials) - len(results.missing)
        yield (
            f"**This comparison is not complete: {done} of {len(about.trials)} trials are "
            f"finished.** Missing: {_named(results.missing)}."
        )
    if not results.records:
        yield "No trial has finished yet."


def _named(trials: Sequence[Trial]) -> str:
    """Missing trials by algorithm and variant with their seeds."""
    groups: dict[tuple[str, str], list[int]] = {}
    for trial in trials:
        groups.setdefault((trial.algorithm, trial.variant), []).append(trial.seed)
    named = [
        f"{plain(algorithm)} on {plain(variant)} (seed{'s' * (len(seeds) > 1)} {_seeds(seeds)})"
        for (algorithm, variant), seeds in groups.items()
    ]
    rest = len(named) - _MOST_NAMED
    return "; ".join(named[:_MOST_NAMED]) + (f"; and {rest} more" if rest > 0 else "")


def overview(results: Results) -> tuple[list[str], list[list[str]]]:
    """The result in a table: its head, and a row an algorithm; no Markdown."""
    rows = [
        [
            algorithm,
            estimate_text(results.estimate(algorithm, "training_area")),
            estimate_text(results.estimate(algorithm, "final_learner")),
            times_text(results.times(algorithm, "threshold_env_steps")),
            number(float(results.values(algorithm, "unsafe").sum())),
        ]
        for algorithm in results.algorithms
    ]
    head = ["algorithm", "area under the training curve", "final learner alone",
            "env steps to the threshold", "unsafe executed, all seeds"]  # fmt: skip
    if results.about.threshold is None:
        head.pop(3)
        rows = [[*row[:3], row[4]] for row in rows]
    return head, rows


def _lead(results: Results) -> str:
    head, rows = overview(results)
    return (
        "Interquartile means over the seeds with 95 % intervals; of times, the medians.\n\n"
        + _caution(results)
        + table(head, [[plain(row[0]), *row[1:]] for row in rows])
    )


def _caution(results: Results, *variants: str) -> str:
    """A paragraph on few seeds, to stand before intervals and verdicts; empty for enough."""
    found = results.caution(*variants)
    return f"**{plain(found)}**\n\n" if found else ""


def _what(results: Results) -> str:
    about = results.about
    threshold = NOTHING if about.threshold is None else number(about.threshold)
    final = "" if about.final_episodes is None else f"; {about.final_episodes} at the end"
    rows = [
        ["task", plain(about.task)],
        ["budget", f"{about.env_steps:,} env steps a trial"],
        ["seeds", f"{len(about.seeds)}: {_seeds(about.seeds)}"],
        ["return from which a policy counts as good (threshold)", threshold],
        [
            "evaluation of the learner alone",
            f"{about.evaluation_episodes} episodes every {about.evaluate_every:,} env steps{final}",
        ],
        ["reward that is learned from", plain(about.rewarded_by)],
        ["what learners see", plain(about.inputs)],
        *(
            [f"domain file{' (base)' * (name == about.base)}", plain(f"{name}: {what}")]
            for name, what in about.variants.items()
        ),
        ["machine", plain(about.machine)],
        ["versions", plain(", ".join(f"{name} {text}" for name, text in about.versions.items()))],
    ]
    return table(["", ""], rows, left=2)


def _seeds(seeds: Sequence[int]) -> str:
    """Seeds as a range where they are one."""
    found = list(seeds)
    if len(found) > 2 and found == list(range(found[0], found[0] + len(found))):
        return f"{found[0]} to {found[-1]}"
    return ", ".join(map(str, found))


def _equal_terms(results: Results) -> Iterable[str]:
    same, different = terms_tables(results)
    yield "## Equal terms"
    yield (
        "Of all algorithms and seeds the same: the task, the seeds of the "
        "environment, the budget in env steps, and the evaluations"
        + (", and:\n\n" + same if same else ".")
    )
    if different:
        yield f"What differs, terms first, then settings ({NOTHING}: there is none):\n\n{different}"
    for algorithm in results.algorithms:
        records = results.of(algorithm)
        if len({json.dumps(r.about.get("settings"), sort_keys=True) for r in records}) > 1:
            yield f"**The trials of {plain(algorithm)} were not made with the same settings.**"


def _results(results: Results, figures: dict[str, str]) -> Iterable[str]:
    yield "## Results"
    yield figures.get("training", "")
    yield figures.get("training-episodes", "")
    yield figures.get("training-units", "")
    yield figures.get("learner", "")
    yield figures.get("estimates", "")
    yield "### Returns\n\n" + _caution(results) + values_table(results, RETURNS)
    if results.about.threshold is not None:
        yield (
            "### Time until good\n\nMedians over the seeds; good is a mean return of at least "
            f"{number(results.about.threshold)}. It takes at least {WINDOW} episodes to tell.\n\n"
            + thresholds_table(results)
        )
    yield (
        "### Safety and outcomes\n\nTotals of a trial's training; of the final policies, means of "
        "an episode.\n\n" + values_table(results, (*SAFETY, *task_measures(results)), medians=True)
    )
    yield "### Effort\n\n" + values_table(results, COST)
    if len(results.algorithms) > 1:
        yield f"## Differences to {plain(results.algorithms[0])}"
        yield (
            "An interval that does not hold 0 tells the two apart.\n\n"
            + _caution(results)
            + differences_table(results)
        )


def _variants(results: Results, figures: dict[str, str]) -> Iterable[str]:
    name = plain(subject(results))
    yield "## How bad may the model be?"
    yield figures.get("variants", "")
    yield _caution(results, *results.variants) + variants_table(results)
    yield (
        f"**Final**: {name}'s final learner is not worse than dqn's: the interval of the "
        f"difference of the means lies above {_limit(results, FINAL_MARGIN)}. **Early**: the mean "
        "return of the first 50 episodes is not below that of the better of the planner alone and "
        f"dqn by more than {percent(EARLY_MARGIN)} of the range: the interval lies above "
        f"{_limit(results, EARLY_MARGIN)}. A check is undecided where its limit lies inside the "
        "interval. All together: all domain files pooled, their seeds resampled by themselves."
    )


def _limit(results: Results, share: float) -> str:
    return f"{number(-share * results.range)} ({percent(share)} of the range of returns)"


def _figure(picture: Picture) -> str:
    address = f"{FIGURES}/{picture.name}.svg"
    return f"![{plain(picture.title)}]({address})\n\n{plain(picture.caption)}"
