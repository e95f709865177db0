"""What a regression is judged by, for reports."""

from __future__ import annotations

from serp.adaptation.adoption import TrackRecord
from serp.adaptation.residual.parameters import FILE, LINEAR, RegressionParameters
from serp.model.transition_model import Vector


def track_records(
    schema: str, p: RegressionParameters, loss: Vector, steps: Vector, change: Vector
) -> list[TrackRecord]:
    """Return the record of each target; `loss` `[4, T]` and `change` `[T]` are mean errors."""
    learned = loss[LINEAR:].min(axis=0) if p.features else loss[LINEAR]
    squares = [(errors**2).tolist() for errors in (loss[FILE], learned, change)]
    used = (p.kinds != FILE).tolist()
    columns = zip(used, steps.tolist(), *squares, strict=True)
    return [TrackRecord(schema, use, int(seen), *errors) for use, seen, *errors in columns]
