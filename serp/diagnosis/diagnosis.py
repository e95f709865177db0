"""The diagnosis of a run: the predictions of its domain file compared with what was observed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from serp.diagnosis.accuracy import END, REWARD, Quantity, Steps, quantities_of
from serp.diagnosis.analysis import findings
from serp.diagnosis.findings import Findings
from serp.diagnosis.patched_model import forecast_with
from serp.diagnosis.recorded_run import Recorded, read_recorded
from serp.diagnosis.relevance import without, worthwhile
from serp.diagnosis.remarks import Remark, remarks
from serp.diagnosis.verdict import unexplained, verdict
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.regression_data import RegressionData


class Worst(NamedTuple):
    """The step with the largest error of the file as written, from a state `[F]`."""

    predicted: float
    observed: float
    state: Vector


class FitRow(NamedTuple):
    """The accuracy for a fluent, `reward` or `terminal` after a ground action, in its own unit.

    Attributes:
        action, fluent: Their names.
        steps: Transitions.
        scale: Observed range over all actions.
        change: Root mean square of the observed change in a step.
        rmse_written: Root mean squared error of the file as written.
        rmse_found: The same of the file patched with the findings worth mentioning.
        cost: Cost of the error of the file, see `serp.diagnosis.findings`.
        predicted: Steps with a predicted change of a predicate, or a predicted end; 0 for numbers.
        happened: Those of these in which it was observed.
        unpredicted: Steps in which it was observed and not predicted.
        worst: The step predicted worst; None where there is no error.
    """

    action: str
    fluent: str
    steps: int
    scale: float
    change: float
    rmse_written: float
    rmse_found: float
    cost: float
    predicted: int
    happened: int
    unpredicted: int
    worst: Worst | None

    @property
    def missed(self) -> int:
        """Steps in which a change came or was predicted, but not both."""
        return self.predicted - self.happened + self.unpredicted


@dataclass(frozen=True)
class Diagnosis:
    """The result of comparing the transitions of a run with its domain file.

    Attributes:
        recorded: The data that the run recorded.
        steps: The transitions that the file is compared with, and its predictions.
        expected: `[N, F + 2]` predictions of the file patched with the findings worth mentioning.
        findings: All findings.
        worthwhile: Findings worth mentioning; `serp repair` writes them into the file.
        matter: Remarks on these, the most costly first.
        others: Remarks on the other findings.
        quantities: The accuracy for each symbol, the reward and the end.
        fits: The accuracy for each ground action and fluent, reward and end, the most costly first.
    """

    recorded: Recorded
    steps: Steps
    expected: Vector
    findings: Findings
    worthwhile: Findings
    matter: tuple[Remark, ...]
    others: tuple[Remark, ...]
    quantities: tuple[Quantity, ...]
    fits: tuple[FitRow, ...]

    @property
    def sample(self) -> RegressionData:
        """The transitions that the file is compared with."""
        return self.steps.sample

    @property
    def verdict(self) -> str:
        """A sentence on the accuracy of the file."""
        if not len(self.sample):
            return "None of these steps can be compared with the file."
        return verdict(self.quantities, bool(self.matter))

    @property
    def unexplained(self) -> list[str]:
        """A sentence for each quantity that the findings do not explain, the worst first."""
        return unexplained(self.quantities)

    def share(self, remark: Remark) -> float:
        """Return the fraction, 0 to 1, of its symbols' squared error that a remark explains."""
        error = sum(q.squared for q in self.quantities if q.name in remark.symbols)
        return min(1.0, max(0.0, remark.cost / error)) if error > 0 else 0.0


def diagnose(run: str | Path) -> Diagnosis:
    """Compare the transitions of a run with the predictions of its domain file.

    Args:
        run: The run's folder; its newest checkpoint is read.

    Raises:
        SerpError: The folder is not a run, or the run recorded nothing; see `read_recorded`.
    """
    recorded = read_recorded(Path(run))
    return make_diagnosis(recorded, findings(recorded.model, recorded.experience))


def make_diagnosis(recorded: Recorded, found: Findings) -> Diagnosis:
    """Return the diagnosis of a run with given findings."""
    model = recorded.model
    steps = Steps.of(model, recorded.experience)

    def accuracy(told: Findings) -> tuple[Vector, tuple[Quantity, ...]]:
        forecast = forecast_with(model, told, steps.sample.states, steps.sample.actions)
        return forecast.mean, quantities_of(model, steps, forecast)

    processes = {process.schema for process in model.ground.processes}
    worthy = worthwhile(found, accuracy(found)[1], processes)
    expected, quantities = accuracy(worthy)
    return Diagnosis(
        recorded=recorded,
        steps=steps,
        expected=expected,
        findings=found,
        worthwhile=worthy,
        matter=tuple(remarks(worthy, model.ground)),
        others=tuple(remarks(without(found, worthy), model.ground)),
        quantities=quantities,
        fits=tuple(_fits(model, steps, expected)),
    )


def _fits(model: TransitionModel, steps: Steps, expected: Vector) -> list[FitRow]:
    names = [*(fluent.name for fluent in model.fluents), REWARD, END]
    numeric = np.array([*(fluent.numeric for fluent in model.fluents), True, False])
    rows: list[FitRow] = []
    count = len(steps.sample)
    if not count:
        return rows
    scale = np.ptp(np.concatenate((steps.before, steps.after)), axis=0)
    for position, action in enumerate(model.actions):
        done = np.flatnonzero(steps.sample.actions == position)
        number = len(done)
        if not number:
            continue
        before, after, predicted = steps.before[done], steps.after[done], steps.predicted[done]
        change, off, left = (
            np.sqrt(np.nanmean((after - other) ** 2, axis=0))
            for other in (before, predicted, expected[done])
        )
        costs = number * (off / steps.units) ** 2 / count
        said, came = (np.abs(to - before) > 0.5 for to in (predicted, after))
        counts = np.stack([said.sum(axis=0), (said & came).sum(axis=0), (came & ~said).sum(axis=0)])
        counts[:, numeric] = 0
        errors = np.nan_to_num(np.abs(after - predicted))
        worst = [
            Worst(float(predicted[k, f]), float(after[k, f]), steps.sample.states[done[k]])
            if errors[k, f]
            else None
            for f, k in enumerate(errors.argmax(axis=0).tolist())
        ]
        numbers = np.stack((scale, change, off, left, costs)).T.tolist()
        columns = zip(names, numbers, counts.T.tolist(), worst, strict=True)
        rows += [
            FitRow._make((action.name, name, number, *own, *counted, case))
            for name, own, counted, case in columns
        ]
    return sorted(rows, key=lambda row: -row.cost)
