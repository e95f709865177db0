"""The tables of a comparison's report, in Markdown."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from serp._util.markdown import plain, table
from serp.comparison.algorithms import DQN
from serp.comparison.analysis.definitions import MEASURES
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import interquartile_mean, mean, standard_deviation
from serp.comparison.analysis.variants import subject, variant_rows
from serp.comparison.report.formatting import (
    NOTHING,
    estimate_text,
    number,
    spread_text,
    times_text,
)

COMPARED = [measure for measure in MEASURES if measure.compared]


def overview(results: Results) -> tuple[list[str], list[list[str]]]:
    """Return the main results: titles of columns, and a row an algorithm; plain text."""
    columns: dict[str, Callable[[str], str]] = {
        "algorithm": str,
        "area under the training curve": lambda a: estimate_text(
            results.estimate(a, "training_area")
        ),
        "final learner alone": lambda a: estimate_text(results.estimate(a, "final_learner")),
        "final policy": lambda a: estimate_text(results.estimate(a, "final_vetoed")),
        "env steps to the threshold": lambda a: times_text(results.times(a, "threshold_env_steps")),
        "unsafe executed, all seeds": lambda a: number(float(results.values(a, "unsafe").sum())),
    }
    if results.plan.threshold is None:
        del columns["env steps to the threshold"]
    return list(columns), [[cell(a) for cell in columns.values()] for a in results.algorithms]


def overview_table(results: Results) -> str:
    """Return `overview` as a table in Markdown."""
    head, rows = overview(results)
    return table(head, [[plain(row[0]), *row[1:]] for row in rows])


def values_table(results: Results, name: str) -> str:
    """Return the measures of a table: interquartile mean with its interval, mean ± deviation.

    Measures that no algorithm has are left out; the text is empty if none is left.
    """
    shown = [
        measure for measure in results.table
        if measure.table == name
        and any(len(results.known(algorithm, measure.name)) for algorithm in results.algorithms)
    ]  # fmt: skip
    if not shown:
        return ""
    rows = []
    for algorithm in results.algorithms:
        values = [results.known(algorithm, measure.name) for measure in shown]
        middles = (estimate_text(results.estimate(algorithm, measure.name)) for measure in shown)
        spreads = (spread_text(float(mean(v)), float(standard_deviation(v))) for v in values)
        rows += [[plain(algorithm), "IQM [95 %]", *middles], ["", "mean ± std", *spreads]]
    return table(["algorithm", "", *(plain(measure.title) for measure in shown)], rows, left=2)


def times_table(results: Results) -> str:
    """Return a row an algorithm: medians of the times to the threshold, `never` counted."""
    shown = [measure for measure in results.table if measure.table == "times"]

    def cell(algorithm: str, name: str, *, time: bool) -> str:
        if time:
            return times_text(results.times(algorithm, name))
        return estimate_text(results.estimate(algorithm, name))

    rows = [
        [plain(algorithm), *(cell(algorithm, m.name, time=m.time) for m in shown)]
        for algorithm in results.algorithms
    ]
    return table(["algorithm", *(measure.title for measure in shown)], rows)


def differences_table(results: Results) -> str:
    """Return the differences of means and interquartile means of each algorithm to the first."""
    first, *others = results.algorithms or ("",)
    rows = []
    for other in others:
        for label, statistic in (("means", mean), ("IQMs", interquartile_mean)):
            cells = [
                estimate_text(results.difference(other, first, m.name, statistic), signed=True)
                for m in COMPARED
            ]
            rows.append([plain(f"{other} − {first}"), label, *cells])
    return table(["difference", "of the", *(m.title for m in COMPARED)], rows, left=2)


def settings_table(results: Results) -> str:
    """Return the characteristics, and the settings that are not the same for all algorithms."""
    found = {name: _told(results.of(name)[0].metadata) for name in results.algorithms}
    rows = []
    for key in dict.fromkeys(key for told in found.values() for key in told):
        # External algorithms have no settings of ours, so these are compared among the others.
        if "." not in key or len({told[key] for told in found.values() if key in told}) > 1:
            rows.append([plain(key), *(plain(told.get(key, NOTHING)) for told in found.values())])
    return table(["what", *map(plain, found)], rows, left=len(found) + 1)


def _told(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return characteristics and settings of a trial."""
    told = {str(key): str(text) for key, text in (metadata.get("characteristics") or {}).items()}
    for section, values in (metadata.get("settings") or {}).items():
        for name, value in values.items():
            told[f"{section}.{name}"] = value if isinstance(value, str) else json.dumps(value)
    return told


def variants_table(results: Results) -> str:
    """Return a row a domain file: returns of planner and learners, and differences to others."""
    ours = plain(subject(results))
    head = [
        "domain file", "seeds", "planner alone", "area under the training curve",
        "first 50 episodes", "final learner alone", f"final: {ours} − {DQN}",
        f"first 50: {ours} − better",
    ]  # fmt: skip
    rows = [
        [
            plain(row.variant),
            str(row.seeds),
            *map(estimate_text, (row.planner, row.area, row.early, row.final)),
            estimate_text(row.final_difference, signed=True),
            f"{estimate_text(row.early_difference, signed=True)} ({plain(row.better)})",
        ]
        for row in variant_rows(results)
    ]
    return table(head, rows)
