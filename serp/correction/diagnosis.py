"""The diagnosis of a run: what its domain file predicted, what was observed, and what follows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from serp.correction.findings import Findings, FluentFit
from serp.correction.monitor import MonitorRow, Side
from serp.correction.recorded import Recorded, read_recorded
from serp.correction.sample import Sample, take_sample
from serp.correction.wording import Finding, Remark, remarks

_SHARE: Final = 0.005
"""A finding is worth mentioning from this share of the error on."""

_MOTION: Final = 1e-4
"""And where it is so much of what changes at all, both squared: 1 % of the change."""


class FitRow(NamedTuple):
    """How one fluent was predicted after one ground action, in the unit of the fluent.

    The columns of `serp diagnose --csv`, without those of the monitor.

    Attributes:
        action, fluent: Their names.
        steps: Transitions.
        scale: Observed range of the fluent, after whatever action.
        change: Root mean square of the observed change in a step.
        rmse_written: Root mean squared error of the file as written.
        rmse_found: The same with all findings taken into account.
        cost: What the error of the file costs, in the unit of `serp.correction.findings`.
    """

    action: str
    fluent: str
    steps: int
    scale: float
    change: float
    rmse_written: float
    rmse_found: float
    cost: float


@dataclass(frozen=True)
class Diagnosis:
    """What the transitions of a run say of its domain file.

    Attributes:
        recorded: What the run recorded.
        sample: The transitions that the file was compared with.
        findings: What was found.
        told: Everything found, in words, the most costly first.
        fits: A row for each ground action and fluent, the most costly first.
        observed: What the monitor counted over the whole run.
        error: Squared error of the file a step, each fluent in units of its range; `error_found`
            with all findings taken into account; `motion` the squared change itself.
    """

    recorded: Recorded
    sample: Sample
    findings: Findings
    told: tuple[Remark, ...]
    fits: tuple[FitRow, ...]
    observed: tuple[MonitorRow, ...]
    error: float
    error_found: float
    motion: float

    @property
    def off(self) -> float:
        """Error of the file as a share of the change; NaN where nothing changed.

        0 for a perfect file, 1 for one that says that everything stays as it is.
        """
        return math.sqrt(self.error / self.motion) if self.motion > 0 else math.nan

    @property
    def off_found(self) -> float:
        """The same with all findings taken into account."""
        return math.sqrt(self.error_found / self.motion) if self.motion > 0 else math.nan

    def share(self, remark: Remark) -> float:
        """Return what share of the squared error a remark accounts for, 0 to 1."""
        return min(1.0, max(0.0, remark.cost / self.error)) if self.error > 0 else 0.0

    @property
    def matter(self) -> tuple[Remark, ...]:
        """What is worth an expert's time: 0.5 % of the squared error, 1 % of the change."""
        return tuple(
            remark
            for remark in self.told
            if self.share(remark) >= _SHARE and remark.cost >= _MOTION * self.motion
        )

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON values; NaN where there is no number."""
        recorded = self.recorded
        return {
            "run": str(recorded.run),
            "domain": recorded.domain.name,
            "files": dict(recorded.files),
            "env_steps": recorded.env_steps,
            "steps": len(self.sample),
            "skipped": self.sample.skipped,
            "error_of_change": self.off,
            "error_of_change_found": self.off_found,
            "remarks": [
                {
                    "text": remark.text,
                    "schema": remark.schema,
                    "line": remark.line,
                    "cost": remark.cost,
                    "share": self.share(remark),
                    "matters": remark in self.matter,
                    "findings": [_finding(finding) for finding in remark.findings],
                }
                for remark in self.told
            ],
            "literals": [_finding(finding) for finding in self.findings.literals],
            "fits": [row._asdict() for row in self.fits],
            "monitor": [self._monitored(row) for row in self.observed],
            "monitor_skipped": recorded.monitor.skipped,
        }

    def _monitored(self, row: MonitorRow) -> dict[str, Any]:
        model = self.recorded.model
        return {
            "action": row.action,
            "fluent": row.fluent,
            "steps": row.samples,
            "scale": row.scale,
            "written": row.written._asdict(),
            "corrected": row.corrected._asdict(),
            "worst": [
                {
                    "predicted": case.written,
                    "corrected": case.corrected,
                    "observed": case.observed,
                    "state": None if case.state is None else model.values(case.state),
                }
                for case in row.worst
            ],
        }

    def table(self) -> Iterator[tuple[str | float | int, ...]]:
        """Yield the head, then a row for each ground action and fluent, for a CSV file.

        What begins with `run` is counted over the whole run, the rest over the transitions kept.
        """
        yield (*FitRow._fields, "run_steps", *(
            f"run_{side}_{name}" for side in ("written", "corrected") for name in Side._fields
        ))  # fmt: skip
        fits = {(row.action, row.fluent): row for row in self.fits}
        for seen in self.observed:
            fit = fits.pop((seen.action, seen.fluent), None)
            # Its last transitions of that action may have left the experience.
            known = fit or (seen.action, seen.fluent, 0, seen.scale, "", "", "", "")
            yield (*known, seen.samples, *seen.written, *seen.corrected)
        empty = ("",) * (1 + 2 * len(Side._fields))
        for fit in fits.values():
            yield (*fit, *empty)


def diagnose(run: str | Path) -> Diagnosis:
    """Compare what a run observed with what its domain file says.

    Args:
        run: The run's folder; its newest checkpoint is read.

    Raises:
        SerpError: It is no run, or one that recorded nothing; see `read_recorded`.
    """
    from serp.correction.estimation import findings

    recorded = read_recorded(Path(run))
    return make_diagnosis(recorded, findings(recorded.model, recorded.experience))


def make_diagnosis(recorded: Recorded, found: Findings) -> Diagnosis:
    """Put findings into words and beside the numbers of the run."""
    experience = recorded.experience
    sample = take_sample(
        recorded.model, experience.states, experience.actions, experience.next_states
    )
    fits = _fits(recorded, sample, found.fits)
    change = (sample.next_states - sample.states) / sample.scale
    number = max(1, len(sample))
    return Diagnosis(
        recorded=recorded,
        sample=sample,
        findings=found,
        told=tuple(remarks(found, recorded.model.ground)),
        fits=tuple(sorted(fits, key=lambda row: -row.cost)),
        observed=tuple(recorded.monitor.rows()),
        error=sum(row.cost for row in fits),
        error_found=sum(row.steps * (row.rmse_found / row.scale) ** 2 for row in fits) / number,
        motion=float((change**2).sum()) / number,
    )


def _fits(recorded: Recorded, sample: Sample, fits: tuple[FluentFit, ...]) -> list[FitRow]:
    model = recorded.model
    actions = {action.name: k for k, action in enumerate(model.actions)}
    columns = {fluent.name: fluent.index for fluent in model.fluents}
    number = max(1, len(sample))
    rows = []
    for fit in fits:
        done = sample.actions == actions[fit.action]
        column = columns[fit.fluent]
        change = (sample.next_states - sample.states)[done, column]
        scale = fit.scale if fit.scale > 0 else 1.0
        rows.append(
            FitRow(
                action=fit.action,
                fluent=fit.fluent,
                steps=fit.samples,
                scale=scale,
                change=float(np.sqrt(np.mean(change**2))) if done.any() else 0.0,
                rmse_written=fit.rmse_written,
                rmse_found=fit.rmse_estimated,
                cost=fit.samples * (fit.rmse_written / scale) ** 2 / number,
            )
        )
    return rows


def _finding(finding: Finding) -> Mapping[str, Any]:
    """Return a finding as JSON values; places become lines."""
    from serp.correction.findings import LiteralFinding, MissingEffect

    if isinstance(finding, LiteralFinding):
        place = finding.parameter.place
        return {
            "kind": "literal", "schema": finding.schema, "fluent": finding.fluent,
            "file": Path(place.source.name).name, "line": place.line, "column": place.column,
            "literal": place.text, "written": finding.written, "estimate": finding.estimate,
            "error": finding.error, "samples": finding.samples, "cost": finding.cost,
        }  # fmt: skip
    if isinstance(finding, MissingEffect):
        return {
            "kind": "missing", "schema": finding.schema, "fluent": finding.fluent,
            "line": None if finding.place is None else finding.place.line, "rate": finding.rate,
            "terms": [
                {"coefficient": t.coefficient, "error": t.error, "fluents": list(t.fluents)}
                for t in finding.terms
            ],
            "samples": finding.samples, "cost": finding.cost,
        }  # fmt: skip
    return {
        "kind": "outcomes", "schema": finding.schema, "line": finding.place.line,
        "outcomes": [
            {"changes": [{"fluent": fluent, "change": change} for fluent, change in o.changes],
             "probability": o.probability, "error": o.error, "written": o.written}
            for o in finding.outcomes
        ],
        "samples": finding.samples, "cost": finding.cost,
    }  # fmt: skip
