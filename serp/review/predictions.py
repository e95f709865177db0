"""What recorded steps were predicted to lead to, and what they led to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import TransitionModel, Vector
from serp.review.run_model import RunModel
from serp.runs.recording import Recording, StoredStep
from serp.sysid.regression_data import predictions

_ROUNDING: Final = 1e-6
"""Error, in units, up to which a prediction is right."""


@dataclass(frozen=True)
class PredictedFluent:
    """One fluent, predicted one step ahead, and observed.

    Attributes:
        fluent: Its name.
        before: Its value before the step.
        predicted: What the file as written predicts; None where it predicts nothing.
        observed: Its value after the step.
        error: Observed less predicted, in units of what the fluent usually changes by in a step
            (root mean square over the recording); infinite where it never changes, of a predicate
            1 where it is not as predicted.
        learned: What the model of the newest checkpoint predicts, where that is something else.
    """

    fluent: str
    before: float | bool
    predicted: float | bool | None
    observed: float | bool
    error: float
    learned: float | bool | None = None


def predictions_of(run: RunModel, recording: Recording, step: StoredStep) -> list[PredictedFluent]:
    """Return what was predicted for a step and what came of it, the largest error first."""
    if step.next_state is None:
        return []
    ground, model = int(step.decision.forecast.ground[step.decision.action]), run.model
    written = _predicted(model, step.state, ground)
    adapted = run.adapted
    learned = None if adapted is None else _predicted(adapted, step.state, ground)
    found = []
    for k, fluent in enumerate(model.fluents):
        shown: Callable[[float], float | bool] = float if fluent.numeric else bool
        observed = float(step.next_state[k])
        error = 0.0
        if written is not None and observed != written[k]:
            error, usual = observed - float(written[k]), float(recording.usual_change[k])
            if not fluent.numeric:
                error = 1.0
            else:
                error = error / usual if usual > 0.0 else math.copysign(math.inf, error)
        other = learned is not None and written is not None and learned[k] != written[k]
        found.append(
            PredictedFluent(
                fluent.name,
                shown(float(step.state[k])),
                None if written is None else shown(float(written[k])),
                shown(observed),
                error,
                shown(float(learned[k])) if other and learned is not None else None,
            )
        )
    return sorted(found, key=lambda each: -abs(each.error))


def _predicted(model: TransitionModel, state: Vector, ground: int) -> Vector | None:
    if ground < 0:
        return None
    step = model.step(state, ground)
    return step.state if step.applicable else None


def predicted_states(model: TransitionModel, states: Vector, actions: NDArray[np.int64]) -> Vector:
    """Return the states `[n, F]` one step ahead; NaN where the model predicts none.

    Args:
        model: The model.
        states: `[n, F]`.
        actions: `[n]` ground actions; -1 where the model does not know the action.
    """
    found, known = np.full_like(states, np.nan), actions >= 0
    if known.any():
        found[known] = predictions(model, states[known], actions[known])
    return found


def error_units(model: TransitionModel, usual: Vector, predicted: Vector) -> Vector:
    """Return the units `[F]` of errors one step ahead; those of predicates are 1.

    Args:
        model: The model.
        usual: What each fluent usually changes by in a step (root mean square).
        predicted: What it is predicted to change by, which counts where it never changes.
    """
    numeric = np.array([fluent.numeric for fluent in model.fluents], np.bool_)
    units = np.where(usual > 0.0, usual, predicted)
    return np.where(numeric & (units > 0.0), units, 1.0)


def in_units(differences: Vector, units: Vector) -> Vector:
    """Return the sizes of errors in units; rounding is no error."""
    errors = np.abs(differences) / units
    errors[errors < _ROUNDING] = 0.0
    return errors
