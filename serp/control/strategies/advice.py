"""The planner's forecasts of an env step as guidance for the learner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import FLOAT32_MAX
from serp.learning.guidance import Guidance
from serp.planning.action_map import ActionForecast


def values_of(forecast: ActionForecast, scale: float) -> NDArray[np.float32]:
    """Return `[E]` the value of the best plan that begins with each action, in units of Q.

    An action without a value (it is not applicable, or not in the model) gets the smallest of the
    other values. Values are clipped to the range of float32, so that all are finite.
    """
    value = forecast.value
    finite = np.isfinite(value)
    if not finite.all():
        value = np.where(finite, value, value[finite].min() if finite.any() else 0.0)
    return np.clip(scale * value, -FLOAT32_MAX, FLOAT32_MAX).astype(np.float32)


def advice(
    forecast: ActionForecast,
    action: int,
    following: ActionForecast | None,
    *,
    scale: float,
    imitate: bool,
) -> Guidance:
    """Return the planner's guidance for an env step; see `Strategy.guidance`.

    `scale` is the factor from the planner's values to units of Q; `imitate` says whether the
    learner is to imitate the planner's action before the step.
    """
    if following is None:
        next_action, next_values = -1, np.zeros(len(forecast.value), np.float32)
    else:
        next_action, next_values = following.choice, values_of(following, scale)
    return Guidance(
        action=forecast.choice if imitate else -1,
        value=float(values_of(forecast, scale)[action]),
        next_action=next_action,
        next_values=next_values,
    )
