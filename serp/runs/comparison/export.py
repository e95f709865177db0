"""Exports of a comparison: every number in three CSV tables, statistics in one JSON object."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Sequence
from typing import Any, Final

from serp._util.files import finite, json_text
from serp.runs.comparison.measures import Measure, Results, subject, variant_rows
from serp.runs.comparison.plan import EPISODE_COLUMNS, EVALUATION_COLUMNS, Columns, Record, Trial
from serp.runs.comparison.statistics import (
    Estimate,
    interquartile_mean,
    mean,
    median,
    standard_deviation,
)
from serp.runs.comparison.tables import COMPARED

FORMAT: Final = 3


def measures_csv(results: Results) -> str:
    """Return a row per trial, a column per measure; empty if not measured, `inf` for never."""
    names = [measure.name for measure in results.table]
    rows = (
        [*trial, *(_cell(values.get(name)) for name in names)]
        for trial, values in results.measured.items()
    )
    return _csv(names, rows)


def episodes_csv(records: Sequence[Record]) -> str:
    """Return the training episodes of all trials; cells of absent counters are empty."""
    names = dict.fromkeys([*EPISODE_COLUMNS, *(name for r in records for name in r.episodes)])
    return _merged(list(names), ((record.trial, record.episodes) for record in records))


def evaluations_csv(records: Sequence[Record]) -> str:
    """Return the evaluation episodes of all trials."""
    return _merged(EVALUATION_COLUMNS, ((record.trial, record.evaluations) for record in records))


def comparison_json(results: Results) -> str:
    """Return metadata, statistics and differences as strict JSON.

    Null stands for what was not measured and for infinity.
    """
    plan = results.plan.model_dump(exclude={"format", "trials", "protocol"})
    about = {field.name: getattr(results.metadata, field.name)
             for field in dataclasses.fields(results.metadata) if field.name != "plan"}  # fmt: skip
    rows = variant_rows(results)
    content = {
        "format": FORMAT,
        **plan,
        **results.plan.protocol.model_dump(),
        **about,
        "base": results.plan.base,
        "seeds": results.plan.seeds,
        "missing": [trial._asdict() for trial in results.missing],
        "range": results.range,
        "measures": {measure.name: measure._asdict() for measure in results.table},
        "characteristics": {
            name: {
                key: results.of(name)[0].metadata.get(key)
                for key in ("characteristics", "settings")
            }
            for name in results.algorithms
        },
        "caution": results.caution,
        "statistics": {
            variant: {
                algorithm: {
                    m.name: _statistic(results, algorithm, m, variant) for m in results.table
                }
                for algorithm in results.on(variant)
            }
            for variant in results.plan.variants
        },
        "differences": _differences(results),
        "model_variants": {"algorithm": subject(results), "rows": [_named(row) for row in rows]},
    }
    return json_text(finite(content))


def _statistic(results: Results, algorithm: str, measure: Measure, variant: str) -> dict[str, Any]:
    values = results.known(algorithm, measure.name, variant)
    found: dict[str, Any] = {
        "seeds": len(values),
        "mean": float(mean(values)),
        "std": float(standard_deviation(values)),
        "median": median(values),
        "iqm": _named(results.estimate(algorithm, measure.name, variant)),
    }
    if measure.time:
        summed = results.times(algorithm, measure.name, variant)
        found |= {"median": summed.median, "median_low": summed.low, "median_high": summed.high,
                  "never": summed.never}  # fmt: skip
    return found


def _differences(results: Results) -> list[dict[str, Any]]:
    first, *others = results.algorithms or ("",)
    return [
        {
            "algorithm": other,
            "less": first,
            "measure": measure.name,
            "mean": _named(results.difference(other, first, measure.name, mean)),
            "iqm": _named(results.difference(other, first, measure.name, interquartile_mean)),
        }
        for other in others
        for measure in COMPARED
    ]


def _named(row: Any) -> dict[str, Any]:
    """Return the fields of a named tuple by name, estimates in it likewise."""
    return {
        name: _named(value) if isinstance(value, Estimate) else value
        for name, value in row._asdict().items()
    }


def _merged(names: Sequence[str], tables: Iterable[tuple[Trial, Columns]]) -> str:
    def rows() -> Iterable[Sequence[Any]]:
        for trial, columns in tables:
            for i in range(len(columns["return"])):
                cells = (columns[name][i].item() if name in columns else None for name in names)
                yield [*trial, *map(_cell, cells)]

    return _csv(names, rows())


def _cell(value: Any) -> Any:
    """Return floats exactly, booleans as 0 and 1, an empty cell for NaN and None."""
    if isinstance(value, bool):
        return int(value)
    return "" if value is None or value != value else value


def _csv(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["algorithm", "variant", "seed", *names])
    writer.writerows(rows)
    return text.getvalue()
