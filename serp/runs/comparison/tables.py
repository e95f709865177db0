"""The tables of a comparison's report, in Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from serp._util.text import markdown_text, table
from serp.runs.comparison.algorithms import DQN
from serp.runs.comparison.measures import MEASURES, Results, subject, variant_rows
from serp.runs.comparison.statistics import (
    Estimate,
    Times,
    interquartile_mean,
    mean,
    standard_deviation,
)

NOTHING: Final = "–"


def number(value: float | None) -> str:
    """Return a number with three or four digits that count; a dash for none."""
    if value is None or math.isnan(value):
        return NOTHING
    return _fixed(value, _decimals([value]))


def estimate_text(found: Estimate, *, signed: bool = False) -> str:
    """Return a value with its interval, if it has one, such as `482.1 [471.0, 495.2]`."""
    if math.isnan(found.value):
        return NOTHING
    numbers = [end for end in found if end is not None]
    decimals = _decimals(numbers)
    value, *ends = (_fixed(end, decimals, signed=signed) for end in numbers)
    return f"{value} [{', '.join(ends)}]" if ends else value


def spread_text(mean: float, deviation: float) -> str:
    """Return a mean with its deviation: `480.3 ± 12.1`."""
    if math.isnan(mean):
        return NOTHING
    decimals = _decimals([mean, deviation])
    return f"{_fixed(mean, decimals)} ± {_fixed(deviation, decimals)}"


def times_text(found: Times) -> str:
    """Return the median, its interval and how often it never happened.

    Such as `12,000 [9,000, never], never in 3 of 10` or `never (8 of 10)`.
    """
    if not found.trials:
        return NOTHING
    if math.isinf(found.median) and (found.low is None or math.isinf(found.low)):
        return f"never ({found.never} of {found.trials})"
    text = _time(found.median)
    if found.low is not None and found.high is not None:
        text += f" [{_time(found.low)}, {_time(found.high)}]"
    if found.never:
        text += f", never in {found.never} of {found.trials}"
    return text


def seeds_text(seeds: Sequence[int]) -> str:
    """Return seeds as a range where they are one: `0 to 4`, `1, 7`."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def _time(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:,.0f}"


def _decimals(values: Sequence[float]) -> int:
    """Return how many decimals leave the largest of some values about four digits, at least."""
    finite = [float(value) for value in values if math.isfinite(value)]
    size = max(map(abs, finite), default=0.0)
    if size == 0 or size >= 1000 or all(value.is_integer() for value in finite):
        return 0
    return min(4, max(1, 2 - math.floor(math.log10(size))))


def _fixed(value: float, decimals: int, *, signed: bool = False) -> str:
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:{'+' if signed else ''},.{decimals}f}"
    if float(text.replace(",", "")) == 0:
        text = text.lstrip("+-")
    return text.replace("-", "−")


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
    return table(head, [[markdown_text(row[0]), *row[1:]] for row in rows])


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
        rows += [
            [markdown_text(algorithm), "IQM [95 %]", *middles],
            ["", "mean ± std", *spreads],
        ]
    return table(
        ["algorithm", "", *(markdown_text(measure.title) for measure in shown)], rows, left=2
    )


def times_table(results: Results) -> str:
    """Return a row an algorithm: medians of the times to the threshold, `never` counted."""
    shown = [measure for measure in results.table if measure.table == "times"]

    def cell(algorithm: str, name: str, *, time: bool) -> str:
        if time:
            return times_text(results.times(algorithm, name))
        return estimate_text(results.estimate(algorithm, name))

    rows = [
        [markdown_text(algorithm), *(cell(algorithm, m.name, time=m.time) for m in shown)]
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
            rows.append([markdown_text(f"{other} − {first}"), label, *cells])
    return table(["difference", "of the", *(m.title for m in COMPARED)], rows, left=2)


def settings_table(results: Results) -> str:
    """Return the characteristics, and the settings that are not the same for all algorithms."""
    found = {name: _told(results.of(name)[0].metadata) for name in results.algorithms}
    rows = []
    for key in dict.fromkeys(key for told in found.values() for key in told):
        # External algorithms have no settings of ours, so these are compared among the others.
        if "." not in key or len({told[key] for told in found.values() if key in told}) > 1:
            rows.append(
                [
                    markdown_text(key),
                    *(markdown_text(told.get(key, NOTHING)) for told in found.values()),
                ]
            )
    return table(["what", *map(markdown_text, found)], rows, left=len(found) + 1)


def _told(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return characteristics and settings of a trial."""
    told = {str(key): str(text) for key, text in (metadata.get("characteristics") or {}).items()}
    for section, values in (metadata.get("settings") or {}).items():
        for name, value in values.items():
            told[f"{section}.{name}"] = value if isinstance(value, str) else json.dumps(value)
    return told


def variants_table(results: Results) -> str:
    """Return a row a domain file: returns of planner and learners, and differences to others."""
    ours = markdown_text(subject(results))
    head = [
        "domain file", "seeds", "planner alone", "area under the training curve",
        "first 50 episodes", "final learner alone", f"final: {ours} − {DQN}",
        f"first 50: {ours} − better",
    ]  # fmt: skip
    rows = [
        [
            markdown_text(row.variant),
            str(row.seeds),
            *map(estimate_text, (row.planner, row.area, row.early, row.final)),
            estimate_text(row.final_difference, signed=True),
            f"{estimate_text(row.early_difference, signed=True)} ({markdown_text(row.better)})",
        ]
        for row in variant_rows(results)
    ]
    return table(head, rows)
