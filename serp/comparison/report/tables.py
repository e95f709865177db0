"""The tables of a comparison's report, in Markdown."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from serp._util.markdown import plain, table
from serp.comparison.algorithms import DQN
from serp.comparison.analysis.definitions import BY_NAME, Measure
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import interquartile_mean, mean, median, standard_deviation
from serp.comparison.analysis.variants import Check, pooled_final, subject, variant_rows
from serp.comparison.metadata import ComparisonMetadata
from serp.comparison.report.formatting import (
    NOTHING,
    estimate_text,
    number,
    seeds_text,
    spread_text,
    times_text,
)

RETURNS: Final = (
    "training_area",
    "learner_area",
    "final_learner",
    "final_vetoed",
    "planner",
    "first_10",
    "first_50",
    "last_20",
)
THRESHOLDS: Final = ("threshold_env_steps", "threshold_episodes", "learner_threshold_env_steps")
SAFETY: Final = (
    "unsafe",
    "avoidable_unsafe",
    "final_learner_unsafe",
    "final_vetoed_unsafe",
    "vetoes",
    "terminated",
)
COST: Final = ("episodes", "planner_share", "seconds", "seconds_per_1000")
DIFFERENCES: Final = (
    "training_area",
    "learner_area",
    "final_learner",
    "first_10",
    "first_50",
    "last_20",
    "threshold_env_steps",
    "unsafe",
)


def overview(results: Results) -> tuple[list[str], list[list[str]]]:
    """Return the main results: titles of columns, and a row an algorithm; plain text."""
    columns: dict[str, Callable[[str], str]] = {
        "algorithm": str,
        "area under the training curve": lambda a: estimate_text(
            results.estimate(a, "training_area")
        ),
        "final learner alone": lambda a: estimate_text(results.estimate(a, "final_learner")),
        "env steps to the threshold": lambda a: times_text(results.times(a, "threshold_env_steps")),
        "unsafe executed, all seeds": lambda a: number(float(results.values(a, "unsafe").sum())),
    }
    if results.metadata.threshold is None:
        del columns["env steps to the threshold"]
    return list(columns), [[cell(a) for cell in columns.values()] for a in results.algorithms]


def overview_table(results: Results) -> str:
    """Return `overview` as a table in Markdown."""
    head, rows = overview(results)
    return table(head, [[plain(row[0]), *row[1:]] for row in rows])


def protocol_table(metadata: ComparisonMetadata) -> str:
    """Return what was compared under which protocol, on what machine, with which versions."""
    threshold = NOTHING if metadata.threshold is None else number(metadata.threshold)
    protocol = metadata.protocol
    rows = [
        ["task", plain(metadata.task)],
        ["budget", f"{protocol.env_steps:,} env steps a trial"],
        ["seeds", f"{len(metadata.seeds)}: {seeds_text(metadata.seeds)}"],
        ["return from which a policy counts as good (threshold)", threshold],
        [
            "evaluation of the learner alone",
            f"{protocol.evaluation_episodes} episodes every {protocol.evaluate_every:,} env steps; "
            f"{protocol.final_episodes} at the end",
        ],
        ["reward that is learned from", plain(metadata.rewarded_by)],
        ["what learners see", plain(metadata.inputs)],
        *(
            [f"domain file{' (base)' * (name == metadata.base)}", plain(f"{name}: {what}")]
            for name, what in metadata.variants.items()
        ),
        ["machine", plain(metadata.machine)],
        [
            "versions",
            plain(", ".join(f"{name} {text}" for name, text in metadata.versions.items())),
        ],
    ]
    return table(["", ""], rows, left=2)


def values_table(results: Results, names: Sequence[str], *, medians: bool = False) -> str:
    """Return two rows an algorithm: interquartile mean with its interval, mean ± deviation.

    Args:
        results: The trials.
        names: Measures; those that no algorithm has are left out.
        medians: Whether a third row has the medians.
    """
    known = {measure.name: measure for measure in results.table}
    shown = [
        name for name in names
        if any(len(results.known(algorithm, name)) for algorithm in results.algorithms)
    ]  # fmt: skip
    rows = []
    for algorithm in results.algorithms:
        values = [results.known(algorithm, name) for name in shown]
        rows += [
            [plain(algorithm), "IQM [95 %]",
             *(estimate_text(results.estimate(algorithm, name)) for name in shown)],
            ["", "mean ± std",
             *(spread_text(float(mean(v)), float(standard_deviation(v))) for v in values)],
        ]  # fmt: skip
        if medians:
            rows.append(["", "median", *(number(median(v)) for v in values)])
    return table(["algorithm", "", *(plain(known[name].title) for name in shown)], rows, left=2)


def task_measures(results: Results) -> tuple[str, ...]:
    """Return the names of the measures that only this task has: outcomes and counters."""
    return tuple(measure.name for measure in results.table if measure.name not in BY_NAME)


def thresholds_table(results: Results) -> str:
    """Return a row an algorithm: medians of the times to the threshold, `never` counted."""
    rows = [
        [
            plain(algorithm),
            *(times_text(results.times(algorithm, name)) for name in THRESHOLDS),
            estimate_text(results.estimate(algorithm, "learner_threshold_held")),
        ]
        for algorithm in results.algorithms
    ]
    titles = [BY_NAME[name].title for name in THRESHOLDS]
    return table(["algorithm", *titles, "threshold held (IQM)"], rows)


def differences_table(results: Results) -> str:
    """Return the differences of means and interquartile means of each algorithm to the first."""
    if len(results.algorithms) < 2:
        return ""
    first, *others = results.algorithms
    rows = []
    for other in others:
        for label, statistic in (("means", mean), ("IQMs", interquartile_mean)):
            cells = [
                estimate_text(results.difference(other, first, name, statistic), signed=True)
                for name in DIFFERENCES
            ]
            rows.append([plain(f"{other} − {first}") if label == "means" else "", label, *cells])
    return table(
        ["difference", "of the", *(BY_NAME[name].title for name in DIFFERENCES)], rows, left=2
    )


def characteristics_tables(results: Results) -> tuple[str, str]:
    """Return the characteristics and settings that all algorithms share, and those that differ.

    Returns:
        A table of what all have in common, and one with a column for each algorithm; each may be
        empty.
    """
    found = {name: _characteristics(results.of(name)[0].metadata) for name in results.algorithms}
    keys = dict.fromkeys(key for mapping in found.values() for key in mapping)
    same, different = [], []
    for key in keys:
        # External algorithms have no settings of ours, so these are compared among the others.
        having = [mapping[key] for mapping in found.values() if key in mapping]
        if len(set(having)) == 1 and (len(having) == len(found) or key[0] == "settings"):
            if key[0] == "characteristics":
                same.append([plain(key[1]), plain(having[0])])
        else:
            cells = (
                plain(mapping[key]) if key in mapping else NOTHING for mapping in found.values()
            )
            different.append([plain(key[1]), *cells])
    columns = len(found) + 1
    return (
        table(["what", "of all algorithms"], same, left=2) if same else "",
        table(["what", *map(plain, found)], different, left=columns) if different else "",
    )


def _characteristics(metadata: Mapping[str, Any]) -> dict[tuple[str, str], str]:
    """Return characteristics and settings of a trial: (key of `metadata`, name) → text."""
    kind = "characteristics"
    found = {(kind, str(key)): str(value) for key, value in (metadata.get(kind) or {}).items()}
    for section, values in (metadata.get("settings") or {}).items():
        for name, value in values.items():
            text = value if isinstance(value, str) else json.dumps(value, default=str)
            found["settings", f"{section}.{name}"] = text
    return found


def variants_table(results: Results) -> str:
    """Return a row a domain file: returns of planner and learners, and the two checks."""
    ours = plain(subject(results))
    head = [
        "domain file", "seeds", "planner alone", "area under the training curve",
        "first 50 episodes", "final learner alone", f"final: {ours} − {DQN}", "",
        f"early: {ours} − better", "",
    ]  # fmt: skip
    rows = [
        [
            plain(row.variant),
            str(row.seeds),
            *map(estimate_text, (row.planner, row.area, row.early, row.final)),
            *_check_cells(row.final_check),
            *_check_cells(row.early_check, named=True),
        ]
        for row in variant_rows(results)
    ]
    pooled = _check_cells(pooled_final(results))
    rows.append(["all together", *[""] * 5, *pooled, "", ""])
    return table(head, rows)


def _check_cells(check: Check, *, named: bool = False) -> tuple[str, str]:
    value = estimate_text(check.difference, signed=True)
    return (f"{value} ({plain(check.to)})" if named else value), check.verdict


def definitions_table(measures: Sequence[Measure]) -> str:
    """Return the definitions of measures."""
    rows = [
        [plain(measure.name), plain(measure.meaning), measure.unit, measure.better or NOTHING]
        for measure in measures
    ]
    return table(["measure", "meaning", "unit", "better"], rows, left=4)
