"""Online learning of the one-step error of the file: who predicts, and when the world has changed.

Each sample is first predicted, then learned from. By these predictions the predictor of each target
is chosen, outliers lose weight (errors have Student's t distribution), and a lasting change of the
world is noticed: then all but the newest samples are forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import MOST, Saved
from serp.model.learned import residual_features as r
from serp.model.learned.adapted_step import columns_in_use, leverage
from serp.model.learned.adoption import BETTER, TrackRecord
from serp.model.learned.residual_features import (
    FEW,
    SETTLED,
    RegressionParameters,
    dot_chunk,
    features_of,
    linear_of,
    rate_of,
)
from serp.model.learned.residual_fit import REMEMBERED, FittedWeights, Mask
from serp.model.native import advanced, pointer_to
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

HUGE = 1e60
"""Numbers of at least this size are not used; sums of their squares would overflow."""

_MEMORY = 0.999  # weight of the past in the losses, per step
_ROBUST = 5.0
"""Errors of more standard deviations weigh less, as under Student's t: by their square (Lange,
Little & Taylor, Journal of the American Statistical Association 84, 1989)."""
_NOTICED, _RECENT, _LASTING = 0.1, 0.85, 0.7
"""A surprise is such an error of more than this fraction of the change. The world
may have changed if this fraction of recent steps are surprises."""


@cached_njit(nogil=True)
def account(sample, head, published, sizes, statistics):
    """Add a sample to the losses.

    A sample is the inputs `[d]`, `[T]` observed next values less those of effects and processes,
    `[T]` whether that is observed, and `[T]` the change. `published` are views of
    `RegressionParameters`; `sizes` are its features, known columns and columns.
    `statistics` are `[4, T]` moving averages of errors by predictor, `[T]` samples in them,
    `[T]` the mean change, `[H, T]` samples of each head, `[1]` the fraction of surprises.

    Returns:
        The weight of the sample in the regression, and whether the world may have changed.
    """
    x, y, valid, change = sample
    centre, shrink, frequency, phase, linear, amplitude, kinds, inverse, typical, scale = published
    features, known, columns = sizes
    loss, seen, spread, samples, surprises = statistics
    depth, count = x.shape[0], y.shape[0]
    room = np.empty(depth + 2 * r.SMOOTH + 4 * count)
    u, z = pointer_to(room, 0), pointer_to(room, depth)
    scratch = pointer_to(room, depth + r.SMOOTH)
    errors = room[depth + 2 * r.SMOOTH :].reshape(4, count)
    for i in range(depth):
        u[i] = (x[i] - centre[i]) * shrink[i]
    for t in range(count):
        errors[r.FILE, t] = y[t]
        for kind in range(3):
            errors[1 + kind, t] = y[t] - linear_of(pointer_to(linear[head, kind, t], 0), u, depth)
    share = 1.0
    known = columns_in_use(known, columns, kinds.max())
    for chunk in range(max(1, features // r.SMOOTH)):
        if features > 0:
            first = chunk * r.SMOOTH
            features_of(pointer_to(frequency, 0), pointer_to(phase, 0), u, depth, first, z)
            for t in range(count):
                for kind in range(1 if chunk > 0 else 0, 2):
                    weights = advanced(pointer_to(amplitude[kind, t], 0), first)
                    errors[r.CURVED + kind, t] -= dot_chunk(weights, z, scratch)
        if chunk == 0:
            share = leverage(
                pointer_to(inverse, 0), inverse.shape[0], known, columns, head, u, depth, z,
            )  # fmt: skip
    worst, surprise = 0.0, False
    for t in range(count):
        if valid[t] and samples[head, t] >= FEW:
            error = errors[int(kinds[t]), t]
            least = 1e-9 * (1.0 + abs(y[t] - error))
            variance = typical[head, t] ** 2 + share * scale[0, t] ** 2 + least * least
            ratio = error * error / variance
            worst = max(worst, ratio)
            if ratio > _ROBUST * _ROBUST and abs(error) > _NOTICED * spread[t]:
                surprise = surprise or samples[head, t] >= SETTLED
    weight = 1.0 if worst <= _ROBUST * _ROBUST else _ROBUST * _ROBUST / worst
    surprises[0] = _RECENT * surprises[0] + (1.0 - _RECENT if surprise else 0.0)
    for t in range(count):
        if not valid[t]:
            continue
        error = errors[int(kinds[t]), t]
        size = abs(error)
        samples[head, t] += 1.0
        if samples[head, t] > SETTLED:
            limited = min(size, 4.0 * typical[head, t] + 1e-12)
            typical[head, t] += 0.02 * weight * (limited - typical[head, t])
        else:
            typical[head, t] += (size * weight - typical[head, t]) / samples[head, t]
        rate = rate_of(seen[t], _MEMORY) * weight  # hardly any for far outliers
        # Over all samples: where a robot keeps still, little changes, and noise is most of it.
        spread[t] += weight / (1.0 + seen[t]) * (abs(change[t]) - spread[t])
        seen[t] += 1.0
        for kind in range(4):
            off = abs(errors[kind, t])
            if kind != r.FILE and seen[t] <= FEW:
                off = min(off, abs(errors[r.FILE, t]))
                if seen[t] == 2.0:
                    loss[kind, t] = off
                    continue
            loss[kind, t] += rate * (off - loss[kind, t])
        # The error where nothing is known, as far as it was seen: at first that of the file.
        scale[2, t] = _MEMORY * scale[2, t] + weight * share
        limit = 4.0 * scale[0, t] ** 2 if seen[t] > SETTLED else np.inf
        scale[3, t] = _MEMORY * scale[3, t] + weight * share * min(error * error, limit)
        scale[0, t] = math.sqrt((scale[3, t] + loss[r.FILE, t] ** 2) / (scale[2, t] + 1.0))
        scale[1, t] = spread[t]
    return weight, surprise and surprises[0] > _LASTING


@cached_njit(nogil=True)
def choose(statistics, features, kinds, enabled):
    """Choose the predictor of each target; return whether any is a residual.

    Of the file and the residuals, the simplest one that no other beats clearly: by 5 %, and
    features by a hundredth of the change too. One that is in use is kept until it is beaten at all.

    `statistics` are those of `account`; `features`: whether there are random features; `enabled`
    `[T]`: whether a residual may predict the target; `kinds` `[T]` receives the choice.
    """
    loss, seen, spread, _, _ = statistics
    residual = False
    for t in range(kinds.shape[0]):
        best = r.FILE
        if enabled[t] and seen[t] >= 2.0:
            now, least = int(kinds[t]), loss[r.FILE, t]
            for kind in range(1, 4 if features else 2):
                factor = 1.0 if kind == now else BETTER
                fine = 0.0 if best == r.FILE else 0.01 * spread[t]
                if loss[kind, t] < factor * least - fine:
                    best, least = kind, loss[kind, t]
        kinds[t] = best
        residual = residual or best != r.FILE
    return residual


_LONG: Final = 24
"""A change is lasting if it goes on in the next episode, or for so many steps: not an impact, nor
what a robot meets at the end of an episode only."""


class ResidualRegression:
    """Learns the one-step error of the targets of alike groups; `parameters` receive the result."""

    def __init__(self, parameters: RegressionParameters, seed: np.random.SeedSequence) -> None:
        p = self._parameters = parameters
        count = p.count
        self._published = (
            p.centre, p.shrink, p.frequency, p.phase, p.linear, p.amplitude, p.kinds, p.inverse,
            p.typical, p.scale,
        )  # fmt: skip
        self._loss, self._samples = np.zeros((4, count)), np.zeros((p.heads, count))
        self._seen, self._spread, self._surprises = np.zeros(count), np.zeros(count), np.zeros(1)
        self._statistics = (
            self._loss, self._seen, self._spread, self._samples, self._surprises,
        )  # fmt: skip
        self._fit = FittedWeights(p, seed)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._parameters.clear()
        for array in self._statistics:
            array[:] = 0
        self._fit.reset()
        self._alarms, self._of_episode = 0, REMEMBERED

    def learn(
        self, head: int, x: Vector, y: Vector, valid: Mask, change: Vector, enabled: Mask
    ) -> bool:
        """Learn from a sample; return whether any target is predicted by a residual now.

        Args:
            head: The head of the action's schema.
            x: `[d]` inputs.
            y: `[T]` observed next values less those of effects and processes.
            valid: `[T]` whether that is observed.
            change: `[T]` observed change.
            enabled: `[T]` whether a residual may predict the target.
        """
        valid = valid & (np.abs(y) < HUGE)
        p, fit = self._parameters, self._fit
        if not valid.any() or not fit.accepts(x):
            return bool(p.kinds.any())
        weight, changed = account(
            (x, y, valid, change), head, self._published,
            (p.features, p.known, p.columns), self._statistics,
        )  # fmt: skip
        fit.keep(x, y, valid, head, weight)
        self._of_episode += 1
        self._alarms = self._alarms + 1 if changed else 0
        if changed and (self._of_episode < REMEMBERED or self._alarms > _LONG):
            self._forget()
        if fit.update(valid):
            self._solve()
        used: bool = choose(self._statistics, p.features > 0, p.kinds, enabled)
        return used

    def begin_episode(self) -> None:
        """Note that the next sample is of another episode."""
        self._of_episode = 0

    def track_records(self, schema: str, head: int) -> list[TrackRecord]:
        """Return what is known of the residual of each target, after actions of a schema."""
        p, loss = self._parameters, self._loss
        steps = self._samples[head]
        learned = loss[r.LINEAR :].min(axis=0) if p.features else loss[r.LINEAR]
        errors = loss[r.FILE].tolist(), learned.tolist()
        columns = zip((p.kinds != r.FILE).tolist(), steps.tolist(), *errors, strict=True)
        return [TrackRecord(schema, use, int(seen), *both) for use, seen, *both in columns]

    def _forget(self) -> None:
        """Forget all but the newest samples, because the environment has changed."""
        p = self._parameters
        p.features = p.known = 0
        p.typical[:] = 0.0
        for array in self._statistics:
            array[:] = 0.0
        self._fit.forget()
        self._solve()

    def _solve(self) -> None:
        # Random features are of use where the linear model leaves a hundredth of the change.
        left = self._loss[r.LINEAR] > 0.01 * self._spread + 1e-18
        if self._fit.solve(bool(left.any())):
            self._loss[r.LINEAR + 1 :] = self._loss[r.LINEAR]

    _RANGES: Final = {
        "seen": (0, MOST), "surprises": (0.0, 1.0),
        "loss": (0.0, np.inf), "spread": (0.0, np.inf), "samples": (0, MOST),
    }  # fmt: skip

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays, meta = self._fit.state_dict()
        arrays |= {name: getattr(self, f"_{name}").copy() for name in self._RANGES}
        return arrays, meta | {"alarms": self._alarms, "of_episode": self._of_episode}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the buffer; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        self._fit.load_state_dict(arrays, meta)
        self._alarms, self._of_episode = saved.whole("alarms"), saved.whole("of_episode")
        for name, (low, high) in self._RANGES.items():
            own = getattr(self, f"_{name}")
            own[:] = saved.array(name, own.dtype, own.shape, low, high)
