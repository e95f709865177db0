"""Export of a diagnosis: as JSON values, and as a table."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from serp.diagnosis.diagnosis import Diagnosis, FitRow
from serp.diagnosis.findings import (
    Finding,
    MissingEffect,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
)
from serp.model.transition_model import TransitionModel
from serp.sysid.monitor import MonitorRow, Side

_KINDS: Final[Mapping[type, str]] = {
    ParameterFinding: "parameter",
    MissingEffect: "missing-effect",
    StochasticEffect: "stochastic-effect",
    RuleFinding: "rule",
}


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as JSON values; NaN where there is no number."""
    recorded = diagnosis.recorded
    return {
        "run": str(recorded.run),
        "domain": recorded.domain.name,
        "files": dict(recorded.files),
        "env_steps": recorded.env_steps,
        "learned_from": recorded.learned_from,
        "steps": len(diagnosis.sample),
        "left_out": dict(diagnosis.sample.left_out),
        "verdict": diagnosis.verdict,
        "quantities": [
            {
                **dataclasses.asdict(quantity),
                "error_of_change": quantity.off,
                "error_of_change_found": quantity.off_left,
                "unexplained": quantity.unexplained,
            }
            for quantity in diagnosis.quantities
        ],
        "not_explained": diagnosis.unexplained,
        "remarks": [
            {
                "text": remark.text,
                "schema": remark.schema,
                "line": remark.line,
                "cost": remark.cost,
                "share": diagnosis.share(remark),
                "matters": matters,
                "findings": [finding_as_dict(finding) for finding in remark.findings],
            }
            for remarks, matters in ((diagnosis.matter, True), (diagnosis.others, False))
            for remark in remarks
        ],
        "parameters": [finding_as_dict(finding) for finding in diagnosis.findings.parameters],
        "fits": [row._asdict() for row in diagnosis.fits],
        "monitor": [_monitor_row(row, recorded.model) for row in diagnosis.observed],
        "monitor_skipped": recorded.monitor.skipped,
    }


def finding_as_dict(finding: Finding) -> Mapping[str, Any]:
    """Return a finding as JSON values; places become lines."""
    values = {field.name: getattr(finding, field.name) for field in dataclasses.fields(finding)}
    place = values.pop("place", None)
    if isinstance(finding, ParameterFinding):
        place = values.pop("parameter").place
        values["text"] = place.text
    if isinstance(finding, MissingEffect):
        values["terms"] = [dataclasses.asdict(term) for term in finding.terms]
        values["rate"] = finding.rate
    if isinstance(finding, StochasticEffect):
        values["outcomes"] = [
            {**dataclasses.asdict(outcome),
             "changes": [{"fluent": name, "change": change} for name, change in outcome.changes]}
            for outcome in finding.outcomes
        ]  # fmt: skip
    where: dict[str, str | int | None] = {"file": None, "line": None, "column": None}
    if place is not None:
        name = Path(place.source.name).name
        where = {"file": name, "line": place.line, "column": place.column}
    return {"kind": _KINDS[type(finding)], **where, **values}


def _monitor_row(row: MonitorRow, model: TransitionModel) -> dict[str, Any]:
    worst = row.worst
    return {
        "action": row.action,
        "fluent": row.fluent,
        "steps": row.samples,
        "scale": row.scale,
        "written": row.written._asdict(),
        "adapted": row.adapted._asdict(),
        "worst": None
        if worst is None
        else {
            "predicted": worst.written,
            "adapted": worst.adapted,
            "observed": worst.observed,
            "state": None if worst.state is None else model.values(worst.state),
        },
    }


def table(diagnosis: Diagnosis) -> Iterator[tuple[str | float | int, ...]]:
    """Yield the head, then a row for each ground action and fluent, for a CSV file.

    Columns that begin with `run` cover the whole run, the others the recorded transitions.
    """
    yield (*FitRow._fields, "run_steps", *(
        f"run_{side}_{name}" for side in ("written", "adapted") for name in Side._fields
    ))  # fmt: skip
    fits = {(row.action, row.fluent): row for row in diagnosis.fits}
    for seen in diagnosis.observed:
        fit = fits.pop((seen.action, seen.fluent), None)
        # The transitions of that action may have been overwritten.
        known = fit or (seen.action, seen.fluent, 0, seen.scale, "", "", "", "")
        yield (*known, seen.samples, *seen.written, *seen.adapted)
    for fit in fits.values():
        yield (*fit, *("",) * (1 + 2 * len(Side._fields)))
