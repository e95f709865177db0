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

from serp._core import ObservedStep, Regression, RegressionSamples
from serp._util.saved_state import MOST, Saved
from serp.model.learned import feature_groups as r
from serp.model.learned.adoption import Reliability, TrackRecord, WorthAdoption
from serp.model.learned.residual_fit import FittedWeights
from serp.pddl.syntax import REWARD, TERMINAL


class ResidualRegression:
    """Learns the one-step error of the targets of alike groups; `parameters` receive the result."""

    _SQUARED = False
    """Whether the errors by which predictors are chosen are squared."""
    _ALONE = 0
    _FEATURES = r.FEATURES
    """Number of the last inputs that random features do not depend on, and of these features."""

    def __init__(self, parameters: Regression, seed: np.random.SeedSequence) -> None:
        self._parameters = parameters
        self._samples = RegressionSamples(parameters, self._SQUARED)
        self._fit = FittedWeights(parameters, self._samples, seed, self._ALONE, self._FEATURES)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._parameters.clear()
        self._samples.clear()
        self._fit.reset()

    def learn(
        self,
        head: int,
        step: ObservedStep,
        inputs: NDArray[np.int64],
        targets: NDArray[np.int64],
        whole: NDArray[np.bool_],
    ) -> None:
        """Learn from a step by the head of its action's schema.

        `inputs` `[d]` and `targets` `[T]` are columns of its states, `whole` `[F]` says which
        fluents have always been whole numbers: a residual does not predict these.
        """
        due = self._samples.learn(head, step, inputs, targets, whole)
        if due != RegressionSamples.NOTHING:
            self._update(due)
            self._samples.choose(targets, whole)

    def _update(self, due: int) -> None:
        if due == RegressionSamples.FORGET:
            self._forget()
        if self._fit.update():
            self._solve()

    def begin_episode(self) -> None:
        """Note that the next sample is of another episode."""
        self._samples.of_episode = 0

    def track_records(self, schema: str, head: int) -> list[TrackRecord]:
        """Return what is known of the residual of each target, after actions of a schema."""
        p, loss = self._parameters, self._samples.loss
        steps = self._samples.samples[head]
        learned = loss[r.LINEAR :].min(axis=0) if p.features else loss[r.LINEAR]
        errors = loss[r.FILE].tolist(), learned.tolist()
        columns = zip((p.kinds != r.FILE).tolist(), steps.tolist(), *errors, strict=True)
        return [TrackRecord(schema, use, int(seen), *both) for use, seen, *both in columns]

    def _forget(self) -> None:
        """Forget all but the newest samples, because the environment has changed."""
        p = self._parameters
        p.features = p.known = 0
        p.typical[:] = 0.0
        self._samples.clear_errors()
        self._fit.forget()
        self._solve()

    def _solve(self) -> None:
        # Random features are of use where the linear model leaves a hundredth of the change.
        loss = self._samples.loss
        least = 0.01 * self._samples.spread
        left = loss[r.LINEAR] > (least**2 if self._SQUARED else least) + 1e-18
        if self._fit.solve(bool(left.any())):
            loss[r.LINEAR + 1 :] = loss[r.LINEAR]

    _RANGES: Final = {
        "seen": (0, MOST), "samples": (0, MOST), "surprises": (0.0, 1.0),
        "loss": (0.0, np.inf), "doubt": (0.0, np.inf), "spread": (0.0, np.inf),
        "reliability": (0.0, MOST),
    }  # fmt: skip

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays, meta = self._fit.state_dict()
        arrays |= {name: getattr(self._samples, name).copy() for name in self._RANGES}
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the model; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        self._fit.load_state_dict(arrays, meta)
        for name, (low, high) in self._RANGES.items():
            own = getattr(self._samples, name)
            own[:] = saved.array(name, own.dtype, own.shape, low, high)


class WorthRegression(ResidualRegression):
    """Learns reward and end of steps beside what the model predicts of them otherwise.

    Ends are rare: of absolute errors "never" has the smallest ones, so errors are squared, and none
    is an outlier. What the model predicts is an input, which random features do not depend on:
    where it is wrong its weight is small, and features are the same for all actions. All features
    would make a step of soccer slower by 27 %, and predict no better than half of them (15 %).
    """

    _SQUARED = True
    _ALONE, _FEATURES = 2, 2 * r.SMOOTH

    def learn_worth(self, head: int, step: ObservedStep, rewarded: bool) -> None:
        """Learn from a step by the head of its ground action; the reward only if `rewarded`."""
        due = self._samples.learn_worth(head, step, rewarded)
        if due != RegressionSamples.NOTHING:
            self._update(due)
            self._samples.choose_worth()

    def adoption(self) -> tuple[WorthAdoption, ...]:
        """Return what predicts reward and end, as far as they were observed."""
        p, samples = self._parameters, self._samples
        bins = tuple(
            Reliability(int(steps), chances / steps, ended / steps)
            for steps, chances, ended in samples.reliability.tolist()
            if steps
        )
        return tuple(
            WorthAdoption(
                name,
                corrected=bool(p.kinds[t] != r.FILE),
                steps=int(samples.seen[t]),
                written=float(samples.loss[r.FILE, t]),
                in_use=float(samples.loss[p.kinds[t], t]),
                reliability=bins if name == TERMINAL else (),
            )
            for t, name in enumerate((REWARD, TERMINAL))
            if samples.seen[t]
        )
