"""The diagnosis of a run: the predictions of its domain file compared with what was observed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from serp._util.text import percent, plural
from serp.errors import RunError
from serp.model.ground_model import Parameter
from serp.model.transition_model import Vector
from serp.pddl.source import Place
from serp.runs.diagnosis.accuracy import (
    WELL,
    Quantity,
    Steps,
    forecast_with,
    quantities_of,
    worthwhile,
)
from serp.runs.diagnosis.analysis import findings
from serp.runs.diagnosis.findings import Finding, Findings
from serp.runs.run import Run


def read_recorded(path: Path) -> Run:
    """Read a run that has recorded env steps, as of its checkpoint, or raise a SerpError."""
    run = Run(path)
    if not len(run.adaptation.experience):
        raise RunError(
            f"{path} has no env step in its checkpoint; train for a while: "
            f"serp plan-and-learn --resume {path}"
        )
    return run


@dataclass(frozen=True)
class Remark:
    """A finding in words, without a full stop, with its line of the file."""

    text: str
    share: float  # of the squared error of its fluents that the finding explains, 0 to 1
    line: int | None
    finding: Finding


@dataclass(frozen=True)
class Diagnosis:
    """The result of comparing the transitions of a run with its domain file.

    Attributes:
        recorded: The run, with the transitions that it recorded.
        steps: The transitions that the file is compared with, and its predictions.
        expected: `[N, F + 2]` predictions of the file patched with the findings worth mentioning.
        worthwhile: Findings worth mentioning; `serp repair` writes them into the file.
        remarks: These in words, the most costly first.
        quantities: The accuracy for each symbol, the reward and the end.
    """

    recorded: Run
    steps: Steps
    expected: Vector
    worthwhile: Findings
    remarks: tuple[Remark, ...]
    quantities: tuple[Quantity, ...]

    @property
    def verdict(self) -> str:
        """A sentence on the accuracy of the file one step ahead."""
        quantities = self.quantities
        if not len(self.steps.sample):
            return "None of these steps can be compared with the file."
        if not quantities:
            return "Nothing changed in these steps, as predicted."
        worst = max(quantities, key=lambda q: q.error)
        good = sum(q.error <= WELL for q in quantities)
        good_left = sum(q.unexplained <= WELL for q in quantities)
        if good == len(quantities):
            text = f"The file predicts well: the largest error, that of {worst.shown}, is "
            return text + f"{percent(worst.error)} of the typical change per step."
        text = f"The file predicts {good} of {len(quantities)} quantities to within "
        text += f"{percent(WELL)} of their change"
        chance = ", apart from random outcomes" if self.worthwhile.stochastic else ""
        left = f", and would predict {good_left} after the proposed edits{chance}."
        return text + (left if self.remarks else ".")

    @property
    def unexplained(self) -> list[str]:
        """A sentence for each quantity that the findings do not explain, the worst first."""
        rest = sorted(self.quantities, key=lambda q: -q.unexplained)
        return [_unexplained(quantity) for quantity in rest if quantity.unexplained > WELL]


def _unexplained(quantity: Quantity) -> str:
    if not quantity.change:
        none = f"there were none in {plural(quantity.steps, 'step')}"
        return f"{quantity.shown}: the file predicts changes, but {none}"
    error = f"{percent(quantity.error)} of the typical change per step"
    text = f"{quantity.shown}: prediction error is {error}"
    if abs(quantity.squared_left - quantity.squared) > 0.01 * quantity.squared:
        text += f"; {percent(quantity.error_left)} after these edits"
    return text


def diagnose(run: str | Path) -> Diagnosis:
    """Compare the transitions of a run with the predictions of its domain file.

    Args:
        run: The run's folder; its newest checkpoint is read.

    Raises:
        SerpError: The folder is not a run, or the run recorded nothing; see `read_recorded`.
    """
    recorded = read_recorded(Path(run))
    return make_diagnosis(recorded, findings(recorded.model, recorded.adaptation.experience))


def make_diagnosis(recorded: Run, found: Findings) -> Diagnosis:
    """Return the diagnosis of a run with given findings."""
    model = recorded.model
    steps = Steps.of(model, recorded.adaptation.experience)

    def accuracy(told: Findings) -> tuple[Vector, tuple[Quantity, ...]]:
        s = steps.sample
        mean, variance = forecast_with(model, told, s.states, s.actions, s.next_states)
        return mean, quantities_of(model, steps, mean, variance)

    processes = {process.schema for process in model.ground.processes}
    kept = worthwhile(found, accuracy(found)[1], processes)
    expected, quantities = accuracy(kept)
    remarks = []
    listed: list[Finding] = [*kept.parameters, *kept.missing, *kept.stochastic, *kept.rules]
    for finding in sorted(listed, key=lambda finding: -finding.cost):
        error = sum(q.squared for q in quantities if q.name in finding.symbols)
        share = min(1.0, max(0.0, finding.cost / error)) if error > 0 else 0.0
        line = None if finding.place is None else finding.place.line
        remarks.append(Remark(finding.sentence(model.ground), share, line, finding))
    return Diagnosis(recorded, steps, expected, kept, tuple(remarks), quantities)


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as JSON values; NaN where there is no number."""
    recorded = diagnosis.recorded
    return {
        "run": str(recorded.path),
        "domain": recorded.domain.name,
        "files": recorded.metadata["domain_files"],
        "env_steps": recorded.env_steps,
        "learned_from": recorded.made.learned_from,
        "steps": len(diagnosis.steps.sample),
        "left_out": dict(diagnosis.steps.sample.left_out),
        "verdict": diagnosis.verdict,
        "quantities": [
            _plain(q) | {"error": q.error, "error_left": q.error_left, "unexplained": q.unexplained}
            for q in diagnosis.quantities
        ],
        "not_explained": diagnosis.unexplained,
        "remarks": [_plain(remark) for remark in diagnosis.remarks],
        "model_in_use": recorded.adaptation.adoption.as_dict(),
    }


def _plain(value: Any) -> Any:
    """Return records as objects with the names of their fields, findings with their kind."""
    if isinstance(value, Parameter):
        value = value.place
    if isinstance(value, Place):
        file = Path(value.source.name).name
        return {"file": file, "line": value.line, "column": value.column, "text": value.text}
    if dataclasses.is_dataclass(value):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"kind": type(value).__name__, **fields} if "cost" in fields else fields
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
