"""The diagnosis of a run: the predictions of its domain file compared with what was observed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from serp._util.saved_state import Saved
from serp.errors import RunError
from serp.model.domain import Domain
from serp.model.ground import Parameter
from serp.model.learned.adoption import ModelAdoption
from serp.model.learned.regression_data import RegressionData
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.source import Place
from serp.runs.agreeing import RunModel
from serp.runs.diagnosis.accuracy import (
    END,
    REWARD,
    Quantity,
    Steps,
    forecast_with,
    quantities_of,
    without,
    worthwhile,
)
from serp.runs.diagnosis.analysis import findings
from serp.runs.diagnosis.findings import Findings
from serp.runs.diagnosis.remarks import Remark, remarks, unexplained, verdict


@dataclass(frozen=True)
class Recorded:
    """The recorded data of a run, as of its newest checkpoint.

    Attributes:
        run: The run's folder.
        domain: The run's copy of the domain.
        files: Name of the copy in the folder → name of the original file.
        model: The domain's transition model as written, with the task's control period.
        experience: The newest transitions.
        adoption: Which parts of the adapted model were in use, and why others were not.
        env_steps: Env steps of the run.
        learned_from: The reward that its learner used: `domain`, `environment` or `sum`.
        notice: A sentence if the newest checkpoint is damaged; else None.
    """

    run: Path
    domain: Domain
    files: Mapping[str, str]
    model: TransitionModel
    experience: TransitionMemory
    adoption: ModelAdoption
    env_steps: int
    learned_from: str
    notice: str | None


def read_recorded(run: Path) -> Recorded:
    """Read the recorded data of a run from its folder.

    Raises:
        RunError: The folder is not a run, it has no intact checkpoint, or its copy of the domain
            was changed.
        DomainError: Its copy of the domain is damaged.
    """
    read = RunModel(run)
    checkpoint, adaptation = read.checkpoint, read.adaptation
    whole = Saved("run", checkpoint.arrays, checkpoint.meta)
    experience = adaptation.experience
    if not len(experience):
        raise RunError(
            f"{run} has no env step in its last checkpoint; train it for a while: "
            f"serp plan-and-learn --resume {run}"
        )
    damage = checkpoint.fallback
    return Recorded(
        run=run,
        domain=read.domain,
        files={str(k): str(v) for k, v in read.folder.metadata["domain_files"].items()},
        model=read.model,
        experience=experience,
        adoption=adaptation.adoption,
        env_steps=whole.whole("env_steps"),
        learned_from=str(read.folder.metadata["config"].get("learned_from", "")),
        notice=None if damage is None else f"{damage} This diagnosis uses the one before.",
    )


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
        cost: Cost of the error of the file, see `serp.runs.diagnosis.findings`.
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
                **_plain(quantity),
                "error_of_change": quantity.off,
                "error_of_change_found": quantity.off_left,
                "unexplained": quantity.unexplained,
            }
            for quantity in diagnosis.quantities
        ],
        "not_explained": diagnosis.unexplained,
        "remarks": [
            {**_plain(remark), "share": diagnosis.share(remark), "matters": matters}
            for remarks, matters in ((diagnosis.matter, True), (diagnosis.others, False))
            for remark in remarks
        ],
        "parameters": _plain(diagnosis.findings.parameters),
        "fits": [
            {**_plain(row), "worst": _worst(row.worst, recorded.model)} for row in diagnosis.fits
        ],
        "model_in_use": recorded.adoption.as_dict(),
    }


def _worst(worst: Worst | None, model: TransitionModel) -> dict[str, Any] | None:
    return None if worst is None else {**worst._asdict(), "state": model.values(worst.state)}


def _plain(value: Any) -> Any:
    """Return records as objects with the names of their fields, findings with their kind."""
    if isinstance(value, Place):
        file = Path(value.source.name).name
        return {"file": file, "line": value.line, "column": value.column, "text": value.text}
    if isinstance(value, Parameter):
        return _plain(value.place)
    if dataclasses.is_dataclass(value):
        fields = dataclasses.fields(value)
        kind = {"kind": type(value).__name__} if any(f.name == "cost" for f in fields) else {}
        return {**kind, **{f.name: _plain(getattr(value, f.name)) for f in fields}}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return {name: _plain(getattr(value, name)) for name in value._fields}
    return [_plain(each) for each in value] if isinstance(value, tuple | list) else value
