"""What errors are measured by: how much the fluents, the reward and the end change in a step."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.monitor import END, REWARD
from serp.sysid.regression_data import RegressionData
from serp.sysid.transitions import TransitionMemory

_ROUNDING = 1e-9
"""Changes of so little of a value's size are none."""


class Steps(NamedTuple):
    """Observed steps, over the fluents, the reward and the end.

    Attributes:
        actions: `[N]` positions of the executed ground actions.
        before: `[N, F + 2]`; reward and end are 0.
        after: `[N, F + 2]`; the end is 1 where the environment ended the task, else 0.
    """

    actions: NDArray[np.int64]
    before: Vector
    after: Vector

    @classmethod
    def of(cls, experience: TransitionMemory, sample: RegressionData) -> Self:
        """Return the steps of a sample that was taken from an experience."""
        rewards, over = experience.rewards[sample.positions], experience.over[sample.positions]
        nothing = np.zeros((len(sample), 2))
        return cls(
            sample.actions,
            np.column_stack((sample.states, nothing)),
            np.column_stack((sample.next_states, rewards, over)),
        )


def symbols_of(model: TransitionModel) -> list[str]:
    """Return what the columns of steps are of: symbols of fluents, `reward`, `terminal`."""
    return [*(fluent.symbol for fluent in model.fluents), REWARD, END]


def units_of(model: TransitionModel, steps: Steps, predicted: Vector) -> Vector:
    """Return the unit of each column `[F + 2]`: the root of its symbol's squared change a step.

    So the squared errors of a symbol, summed over its fluents, are a share of its squared change.
    What never changes but was predicted to is measured by the predicted change, and what does
    neither by 1.

    Args:
        model: The model as written.
        steps: What was observed.
        predicted: `[N, F + 2]` what the model predicts; NaN where nothing.
    """
    names = np.array(symbols_of(model))
    units = np.ones(len(names))
    largest = np.abs(np.concatenate((steps.before, steps.after))).max(axis=0, initial=0.0)
    for name in dict.fromkeys(names.tolist()):
        own = names == name
        least = _ROUNDING * float(largest[own].max())
        for after in (steps.after, predicted):
            squares = (after - steps.before)[:, own] ** 2
            moved = float(np.sqrt(np.nansum(squares) / max(1, len(squares))))
            if moved > least:
                units[own] = moved
                break
    return units
