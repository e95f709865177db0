"""The diagnosis of a run: what its domain file predicted, what was observed, and what follows."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from serp.diagnosis.accuracy import Quantity, quantities_of
from serp.diagnosis.error_scales import Steps, units_of
from serp.diagnosis.findings import (
    Findings,
    MissingEffect,
    OutcomeFinding,
    ParameterFinding,
    RuleFinding,
)
from serp.diagnosis.patched_model import forecast_with
from serp.diagnosis.recorded_run import Recorded, read_recorded
from serp.diagnosis.relevance import without, worthwhile
from serp.diagnosis.verdict import unexplained, verdict
from serp.diagnosis.wording import Finding, Remark, remarks
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.monitor import END, REWARD, MonitorRow, Side
from serp.sysid.regression_data import RegressionData, predicted_steps, regression_data

_KINDS: Final[Mapping[type, str]] = {
    ParameterFinding: "literal", MissingEffect: "missing", OutcomeFinding: "outcomes",
    RuleFinding: "rule",
}  # fmt: skip


class FitRow(NamedTuple):
    """How a fluent, the reward or the end was predicted after one ground action, in its own unit.

    The columns of `serp diagnose --csv`, without those of the monitor.

    Attributes:
        action, fluent: Their names; `reward`, and `terminal` for the end.
        steps: Transitions.
        scale: Observed range, after whatever action.
        change: Root mean square of the observed change in a step.
        rmse_written: Root mean squared error of the file as written.
        rmse_found: The same with what is worth mentioning taken into account.
        cost: What the error of the file costs, in the unit of `serp.diagnosis.findings`.
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
        steps: What was observed in them.
        predicted: `[N, F + 2]` what the file predicts of them.
        expected: The same with what is worth mentioning taken into account.
        findings: What was found.
        worthwhile: What of it is worth mentioning, which is what `serp repair` writes.
        matter: That in words, the most costly first.
        others: The other findings in words.
        quantities: How well the fluents, the reward and the end are predicted.
        fits: A row for each ground action and fluent, reward and end, the most costly first.
        observed: What the monitor counted over the whole run.
    """

    recorded: Recorded
    sample: RegressionData
    steps: Steps
    predicted: Vector
    expected: Vector
    findings: Findings
    worthwhile: Findings
    matter: tuple[Remark, ...]
    others: tuple[Remark, ...]
    quantities: tuple[Quantity, ...]
    fits: tuple[FitRow, ...]
    observed: tuple[MonitorRow, ...]

    @property
    def verdict(self) -> str:
        """What the file's predictions are worth, in words."""
        if not len(self.sample):
            return "None of these steps can be compared with the file."
        return verdict(self.quantities, bool(self.matter))

    @property
    def unexplained(self) -> list[str]:
        """A sentence for each quantity that nothing found explains, the worst first."""
        return unexplained(self.quantities)

    def share(self, remark: Remark) -> float:
        """Return what share of the squared error of what it is about a remark accounts for."""
        error = sum(q.squared for q in self.quantities if q.name in remark.symbols)
        return min(1.0, max(0.0, remark.cost / error)) if error > 0 else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON values; NaN where there is no number."""
        recorded = self.recorded
        return {
            "run": str(recorded.run),
            "domain": recorded.domain.name,
            "files": dict(recorded.files),
            "env_steps": recorded.env_steps,
            "learned_from": recorded.learned_from,
            "steps": len(self.sample),
            "left_out": dict(self.sample.left_out),
            "verdict": self.verdict,
            "quantities": [
                {
                    **dataclasses.asdict(quantity),
                    "error_of_change": quantity.off,
                    "error_of_change_found": quantity.off_left,
                    "unexplained": quantity.unexplained,
                }
                for quantity in self.quantities
            ],
            "not_explained": self.unexplained,
            "remarks": [
                {
                    "text": remark.text,
                    "schema": remark.schema,
                    "line": remark.line,
                    "cost": remark.cost,
                    "share": self.share(remark),
                    "matters": matters,
                    "findings": [finding_as_dict(finding) for finding in remark.findings],
                }
                for remarks, matters in ((self.matter, True), (self.others, False))
                for remark in remarks
            ],
            "literals": [finding_as_dict(finding) for finding in self.findings.literals],
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
    from serp.diagnosis.estimation import findings

    recorded = read_recorded(Path(run))
    return make_diagnosis(recorded, findings(recorded.model, recorded.experience))


def make_diagnosis(recorded: Recorded, found: Findings) -> Diagnosis:
    """Put findings into words and beside the numbers of the run."""
    model, experience = recorded.model, recorded.experience
    sample = regression_data(model, experience.states, experience.actions, experience.next_states)
    steps = Steps.of(experience, sample)
    predicted = predicted_steps(model, sample.states, sample.actions)
    units = units_of(model, steps, predicted)

    def accuracy(told: Findings) -> tuple[Vector, tuple[Quantity, ...]]:
        forecast = forecast_with(model, told, sample.states, sample.actions)
        return forecast.mean, quantities_of(model, steps, predicted, forecast, units)

    processes = {process.schema for process in model.ground.processes}
    worthy = worthwhile(found, accuracy(found)[1], processes)
    expected, quantities = accuracy(worthy)
    return Diagnosis(
        recorded=recorded,
        sample=sample,
        steps=steps,
        predicted=predicted,
        expected=expected,
        findings=found,
        worthwhile=worthy,
        matter=tuple(remarks(worthy, model.ground)),
        others=tuple(remarks(without(found, worthy), model.ground)),
        quantities=quantities,
        fits=tuple(_fits(model, sample, steps, predicted, expected, units)),
        observed=tuple(recorded.monitor.rows()),
    )


def _fits(
    model: TransitionModel,
    sample: RegressionData,
    steps: Steps,
    predicted: Vector,
    expected: Vector,
    units: Vector,
) -> list[FitRow]:
    names = [*(fluent.name for fluent in model.fluents), REWARD, END]
    rows: list[FitRow] = []
    if not len(sample):
        return rows
    scale = np.ptp(np.concatenate((steps.before, steps.after)), axis=0)
    for position, action in enumerate(model.actions):
        done = sample.actions == position
        if not done.any():
            continue
        after = steps.after[done]
        change, off, left = (
            np.sqrt(np.nanmean((after - other[done]) ** 2, axis=0))
            for other in (steps.before, predicted, expected)
        )
        costs = done.sum() * (off / units) ** 2 / len(sample)
        columns = zip(names, scale, change, off, left, costs, strict=True)
        rows += [FitRow(action.name, name, int(done.sum()), *map(float, c)) for name, *c in columns]
    return sorted(rows, key=lambda row: -row.cost)


def finding_as_dict(finding: Finding) -> Mapping[str, Any]:
    """Return a finding as JSON values; places become lines."""
    values = {field.name: getattr(finding, field.name) for field in dataclasses.fields(finding)}
    place = values.pop("place", None)
    if isinstance(finding, ParameterFinding):
        place = values.pop("parameter").place
        values["literal"] = place.text
    if isinstance(finding, MissingEffect):
        values["terms"] = [dataclasses.asdict(term) for term in finding.terms]
    if isinstance(finding, OutcomeFinding):
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
