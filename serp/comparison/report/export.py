"""Exports every number of a comparison: three CSV tables and one JSON object."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

from serp._util.json_files import finite, json_text
from serp.comparison.analysis.results import Results
from serp.comparison.analysis.statistics import (
    Estimate,
    interquartile_mean,
    mean,
    median,
    standard_deviation,
)
from serp.comparison.analysis.variants import Check, pooled_final, subject, variant_rows
from serp.comparison.report.tables import DIFFERENCES
from serp.comparison.trial_records import (
    EPISODE_COLUMNS,
    EVALUATION_COLUMNS,
    Columns,
    Record,
    Trial,
)

FORMAT = 2
_LEADING = ("algorithm", "variant", "seed")


def measures_csv(results: Results) -> str:
    """Return a row per trial, a column per measure; empty if not measured, `inf` for never."""
    names = [measure.name for measure in results.table]
    rows = (
        [*trial, *(_cell(values.get(name)) for name in names)]
        for trial, values in results.measured.items()
    )
    return _csv([*_LEADING, *names], rows)


def episodes_csv(records: Sequence[Record]) -> str:
    """Return the training episodes of all trials; cells of absent counters are empty."""
    extra = {name: None for record in records for name in record.episodes}
    names = list(dict.fromkeys([*EPISODE_COLUMNS, *extra]))
    return _merged(names, ((record.trial, record.episodes) for record in records))


def evaluations_csv(records: Sequence[Record]) -> str:
    """Return the evaluation episodes of all trials."""
    return _merged(EVALUATION_COLUMNS, ((record.trial, record.evaluations) for record in records))


def comparison_json(results: Results) -> str:
    """Return everything that the report says, as strict JSON.

    Null stands for what was not measured and for infinity; a trial's `never` names the times until
    what did not happen, its `too_few_episodes` the measures that it has too few episodes for.
    """
    metadata = results.metadata
    about = dataclasses.asdict(metadata)
    protocol = about.pop("protocol")
    del about["trials"]
    content = {
        "format": FORMAT,
        **about,
        **protocol,
        "seeds": metadata.seeds,
        "missing": [trial._asdict() for trial in results.missing],
        "range": results.range,
        "measures": {measure.name: measure._asdict() for measure in results.table},
        "characteristics": {
            name: {
                "characteristics": results.of(name)[0].metadata.get("characteristics"),
                "settings": results.of(name)[0].metadata.get("settings"),
            }
            for name in results.algorithms
        },
        "caution": results.caution(*results.variants),
        "trials": [_trial(results, trial) for trial in results.measured],
        "statistics": {variant: _statistics(results, variant) for variant in results.variants},
        "differences": _differences(results),
        "model_variants": _variants(results),
    }
    return json_text(finite(content))


def _trial(results: Results, trial: Trial) -> dict[str, Any]:
    values = results.measured[trial]
    never = [name for name, value in values.items() if math.isinf(value)]
    few = list(results.undecided[trial])
    return {**trial._asdict(), "measures": values, "never": never, "too_few_episodes": few}


def _statistics(results: Results, variant: str) -> dict[str, Any]:
    return {
        algorithm: {
            measure.name: _statistic(results, algorithm, measure.name, variant, measure.time)
            for measure in results.table
        }
        for algorithm in results.on(variant)
    }


def _statistic(
    results: Results, algorithm: str, name: str, variant: str, time: bool
) -> dict[str, Any]:
    values = results.known(algorithm, name, variant)
    found: dict[str, Any] = {
        "seeds": len(values),
        "mean": float(mean(values)),
        "std": float(standard_deviation(values)),
        "median": median(values),
        "iqm": _estimate(results.estimate(algorithm, name, variant)),
    }
    if time:
        summed = results.times(algorithm, name, variant)
        found |= {"median": summed.median, "median_low": summed.low, "median_high": summed.high,
                  "never": summed.never, "too_few_episodes": summed.too_few}  # fmt: skip
    return found


def _differences(results: Results) -> list[dict[str, Any]]:
    if not results.algorithms:
        return []
    first, *others = results.algorithms
    return [
        {
            "algorithm": other,
            "less": first,
            "measure": name,
            "mean": _estimate(results.difference(other, first, name, mean)),
            "iqm": _estimate(results.difference(other, first, name, interquartile_mean)),
        }
        for other in others
        for name in DIFFERENCES
    ]


def _variants(results: Results) -> dict[str, Any]:
    rows = variant_rows(results)
    if len(rows) < 2:
        return {}
    return {
        "algorithm": subject(results),
        "rows": [
            {key: _plain_value(value) for key, value in row._asdict().items()} for row in rows
        ],
        "all_final_check": _plain_value(pooled_final(results)),
    }


def _plain_value(value: Any) -> Any:
    if isinstance(value, Estimate):
        return _estimate(value)
    if isinstance(value, Check):
        return value._asdict() | {"difference": _estimate(value.difference)}
    return value


def _estimate(found: Estimate | None) -> dict[str, float | None] | None:
    return None if found is None else found._asdict()


def _merged(names: Sequence[str], tables: Iterable[tuple[Trial, Columns]]) -> str:
    def rows() -> Iterable[Sequence[Any]]:
        for trial, columns in tables:
            count = len(next(iter(columns.values()), ()))
            cells = [_cells(columns[name].tolist()) if name in columns else [""] * count
                     for name in names]  # fmt: skip
            for row in zip(*cells, strict=True):
                yield (*trial, *row)

    return _csv([*_LEADING, *names], rows())


def _cells(values: list[Any]) -> list[Any]:
    if values and isinstance(values[0], bool | float):
        return [_cell(value) for value in values]
    return values


def _cell(value: Any) -> Any:
    """Return floats exactly, booleans as 0 and 1, an empty cell for NaN and None."""
    if isinstance(value, bool):
        return int(value)
    return "" if value is None or value != value else value


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
