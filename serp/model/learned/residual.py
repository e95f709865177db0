"""Online learning of the one-step error of the file: who predicts, and when the world has changed.

Each sample is first predicted, then learned from. By these predictions the predictor of each target
is chosen, outliers lose weight (errors have Student's t distribution), and a lasting change of the
world is noticed: then all but the newest samples are forgotten.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._core import PredictionErrors, Regression
from serp._util.saved_state import MOST, Saved
from serp.model.learned import residual_features as r
from serp.model.learned.adoption import TrackRecord
from serp.model.learned.residual_fit import REMEMBERED, FittedWeights, Mask
from serp.model.transition_model import Vector

HUGE = 1e60
"""Numbers of at least this size are not used; sums of their squares would overflow."""

_LONG: Final = 24
"""A change is lasting if it goes on in the next episode, or for so many steps: not an impact, nor
what a robot meets at the end of an episode only."""


class ResidualRegression:
    """Learns the one-step error of the targets of alike groups; `parameters` receive the result."""

    def __init__(self, parameters: Regression, seed: np.random.SeedSequence) -> None:
        self._parameters = parameters
        self._errors = PredictionErrors(parameters)
        self._fit = FittedWeights(parameters, seed)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._parameters.clear()
        self._errors.clear()
        self._fit.reset()
        self._alarms, self._of_episode = 0, REMEMBERED

    def learn(
        self, head: int, x: Vector, y: Vector, valid: Mask, change: Vector, enabled: Mask
    ) -> None:
        """Learn from a sample.

        Args:
            head: The head of the action's schema.
            x: `[d]` inputs.
            y: `[T]` observed next values less those of effects and processes.
            valid: `[T]` whether that is observed.
            change: `[T]` observed change.
            enabled: `[T]` whether a residual may predict the target.
        """
        valid = valid & (np.abs(y) < HUGE)
        fit = self._fit
        if not valid.any() or not fit.accepts(x):
            return
        weight, changed = self._errors.account(head, x, y, valid, change)
        fit.keep(x, y, valid, head, weight)
        self._of_episode += 1
        self._alarms = self._alarms + 1 if changed else 0
        if changed and (self._of_episode < REMEMBERED or self._alarms > _LONG):
            self._forget()
        if fit.update(valid):
            self._solve()
        self._errors.choose(enabled)

    def begin_episode(self) -> None:
        """Note that the next sample is of another episode."""
        self._of_episode = 0

    def track_records(self, schema: str, head: int) -> list[TrackRecord]:
        """Return what is known of the residual of each target, after actions of a schema."""
        p, loss = self._parameters, self._errors.loss
        steps = self._errors.samples[head]
        learned = loss[r.LINEAR :].min(axis=0) if p.features else loss[r.LINEAR]
        errors = loss[r.FILE].tolist(), learned.tolist()
        columns = zip((p.kinds != r.FILE).tolist(), steps.tolist(), *errors, strict=True)
        return [TrackRecord(schema, use, int(seen), *both) for use, seen, *both in columns]

    def _forget(self) -> None:
        """Forget all but the newest samples, because the environment has changed."""
        p = self._parameters
        p.features = p.known = 0
        p.typical[:] = 0.0
        self._errors.clear()
        self._fit.forget()
        self._solve()

    def _solve(self) -> None:
        # Random features are of use where the linear model leaves a hundredth of the change.
        loss = self._errors.loss
        left = loss[r.LINEAR] > 0.01 * self._errors.spread + 1e-18
        if self._fit.solve(bool(left.any())):
            loss[r.LINEAR + 1 :] = loss[r.LINEAR]

    _RANGES: Final = {
        "seen": (0, MOST), "surprises": (0.0, 1.0),
        "loss": (0.0, np.inf), "spread": (0.0, np.inf), "samples": (0, MOST),
    }  # fmt: skip

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays, meta = self._fit.state_dict()
        arrays |= {name: getattr(self._errors, name).copy() for name in self._RANGES}
        return arrays, meta | {"alarms": self._alarms, "of_episode": self._of_episode}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the model; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        self._fit.load_state_dict(arrays, meta)
        self._alarms, self._of_episode = saved.whole("alarms"), saved.whole("of_episode")
        for name, (low, high) in self._RANGES.items():
            own = getattr(self._errors, name)
            own[:] = saved.array(name, own.dtype, own.shape, low, high)
