"""Where the file was wrong: its predictions one step ahead, compared with what was observed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.number_format import percent, readable
from serp._util.text import plural
from serp.model.transition_model import TransitionModel, Vector
from serp.report.recorded_steps import RecordedSteps
from serp.review.predictions import error_units, in_units, predicted_states

_LARGE: Final = 0.05
"""Share of the steps whose largest errors are called large."""
_MOST: Final = 12
"""Fluents and actions in the table, and worst steps in the list."""
_HEAT: Final = (0.1, 0.5, 1.0, 2.0)
"""Errors, in units, from which a cell is coloured more."""


@dataclass(frozen=True)
class ModelErrors:
    """Predictions of the model as written, one step ahead.

    Attributes:
        predicted: Next states `[N, F]`; NaN where there is no prediction.
        units: `[F]` what a fluent usually changes by in a step (root mean square); of predicates 1.
        errors: `[N, F]` absolute errors in these units; NaN without a prediction.
        largest: `[N]` the largest error of a step; 0 without a prediction.
        limit: Errors from here on are called large: those of a twentieth of the steps, at least 1.
    """

    predicted: Vector
    units: Vector
    errors: Vector
    largest: Vector
    limit: float

    @property
    def mean(self) -> float | None:
        """Root mean square of all errors; None without any."""
        known = np.isfinite(self.errors)
        return float(np.sqrt(np.mean(self.errors[known] ** 2))) if known.any() else None


def model_errors(model: TransitionModel, steps: RecordedSteps, usual: Vector) -> ModelErrors:
    """Compare what the model as written predicts with what was observed.

    Args:
        model: The model.
        steps: The steps.
        usual: `[F]` what a fluent usually changes by; one that never changes is measured by what
            it is predicted to change by.
    """
    model, states = model.written, steps["state"]
    predicted = predicted_states(model, states, steps.ground)
    said = np.nan_to_num(predicted - states)
    units = error_units(model, usual, np.sqrt(np.square(said).sum(axis=0) / max(1, len(said))))
    errors = in_units(predicted - steps.next_states, units)
    largest = np.nan_to_num(errors).max(axis=1, initial=0.0)
    limit = float(np.quantile(largest, 1.0 - _LARGE)) if len(largest) else 0.0
    return ModelErrors(predicted, units, errors, largest, max(1.0, limit))


def error_table(
    found: ModelErrors, model: TransitionModel, actions: list[str], steps: RecordedSteps
) -> dict[str, Any]:
    """Return the table of errors by fluent and action, and the worst steps, for the page."""
    squares = np.nan_to_num(found.errors) ** 2
    known = np.isfinite(found.errors).all(axis=1)
    if not known.any():
        return {"rows": [], "says": "There are no predictions to compare."}
    executed = steps["action"]
    used = [a for a in range(len(actions)) if (executed[known] == a).any()]
    by_fluent = squares[known].mean(axis=0)
    wrong = [int(f) for f in np.argsort(-by_fluent, kind="stable") if by_fluent[f] > 0.0]
    if not wrong:
        says = f"Every prediction of the file came true, in {plural(int(known.sum()), 'step')}."
        return {"rows": [], "says": says}
    worst_first = sorted(used, key=lambda a: -float(squares[known & (executed == a)].mean()))
    shown = sorted(worst_first[:_MOST])
    rows = [
        {
            "fluent": model.fluents[f].name,
            "unit": readable(float(found.units[f])) if model.fluents[f].numeric else "–",
            "cells": [_cell(found, model, f, a, actions, known & (executed == a)) for a in shown],
        }
        for f in wrong[:_MOST]
    ]
    left = [text for text in (_left(len(wrong), "fluent"), _left(len(used), "action")) if text]
    return {
        "says": f"The file as it is written, without what the run learned, predicts the next step: "
        f"compared with what was observed in {plural(int(known.sum()), 'step')}.",
        "rows": rows,
        "actions": [actions[a] for a in shown],
        "left": " and ".join(left),
        "worst": _worst(found, model, steps, actions),
    }


def _left(count: int, what: str) -> str:
    return f"{plural(count - _MOST, what)} with smaller errors left out" if count > _MOST else ""


def _cell(
    found: ModelErrors,
    model: TransitionModel,
    fluent: int,
    action: int,
    actions: list[str],
    rows: NDArray[np.bool_],
) -> dict[str, Any]:
    errors = found.errors[rows, fluent]
    size = float(np.sqrt(np.mean(errors**2)))
    about = model.fluents[fluent]
    large = (errors >= (found.limit if about.numeric else 1.0)).any()
    off = f"off by {readable(found.limit)} or more" if about.numeric else "came out otherwise"
    shown = "0" if size == 0.0 else "< 0.01" if size < 0.01 else f"{size:.2f}"
    return {
        "shown": shown if about.numeric else percent(size**2),
        "heat": sum(size >= limit for limit in _HEAT),
        "test": {"executed": [action], "fluents": [fluent]} if large else None,
        "says": f"{actions[action]}: ({about.name}) {off}",
    }


def _worst(
    found: ModelErrors, model: TransitionModel, steps: RecordedSteps, actions: list[str]
) -> list[dict[str, Any]]:
    """Return the worst steps: of each fluent and action the worst one, and of these some."""
    errors = np.nan_to_num(found.errors)
    executed = steps["action"]
    cells = []
    for action in np.unique(executed).tolist():
        rows = np.flatnonzero(executed == action)
        for fluent, at in enumerate(errors[rows].argmax(axis=0).tolist()):
            cells.append((-float(errors[rows[at], fluent]), int(rows[at]), fluent))
    worst = []
    for error, step, fluent in sorted(cells)[:_MOST]:
        if -error < _HEAT[0]:
            break
        about = model.fluents[fluent]
        said, came = (
            readable(float(values[step, fluent])) if about.numeric
            else str(bool(values[step, fluent])).lower()
            for values in (found.predicted, steps.next_states)
        )  # fmt: skip
        worst.append(
            {
                "step": step,
                "where": steps.place_of(step),
                "says": f"after {actions[int(executed[step])]}: ({about.name}) predicted {said}, "
                f"observed {came}",
            }
        )
    return worst
