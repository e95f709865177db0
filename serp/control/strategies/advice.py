"""The planner's view of one env step, in the form that the learner uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import FLOAT32_MAX
from serp.learning.guidance import Guidance
from serp.planning.action_map import ActionForecast


def values_of(forecast: ActionForecast, scale: float) -> NDArray[np.float32]:
    """Return `[E]` what the best plan from each action on is worth, in units of Q.

    An action that the planner gives no value (it is not applicable, or not in the model) is worth
    as much as the least of the others, and what float32 cannot hold as its largest number, so that
    nothing is infinite.
    """
    value = forecast.value
    finite = np.isfinite(value)
    if not finite.all():
        value = np.where(finite, value, value[finite].min() if finite.any() else 0.0)
    held = np.clip(scale * value, -FLOAT32_MAX, FLOAT32_MAX)
    scaled: NDArray[np.float32] = held.astype(np.float32)
    return scaled


def advice(
    forecast: ActionForecast,
    action: int,
    following: ActionForecast | None,
    *,
    scale: float,
    imitate: bool,
) -> Guidance:
    """Return the planner's view of an env step.

    Args:
        forecast: Of the state that was acted in.
        action: The executed environment action.
        following: Forecast of the next state; None where the episode ended there.
        scale: What planner's rewards are multiplied by to give units of Q.
        imitate: Whether the planner's action is to be imitated in the state acted in.
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
