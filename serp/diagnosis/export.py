"""A diagnosis as JSON values."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from serp.diagnosis.diagnosis import Diagnosis, Worst
from serp.model.ground import Parameter
from serp.model.transition_model import TransitionModel
from serp.pddl.source import Place


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
