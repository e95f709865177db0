"""Online learning of the one-step error of the file, for one feature group.

Recursive ridge regression of the error of every target, on inputs normalised by their ranges:
linear, and with random Fourier features if the linear model leaves a large error. The candidate
that predicts best is published; the file itself is one of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import LARGEST, MOST, Saved, nested, part_of
from serp.adaptation.adoption import TrackRecord
from serp.adaptation.feature_groups import FeatureGroup
from serp.adaptation.parameter_buffer import FILE, LINEAR, MODES, NONLINEAR, GroupParameters
from serp.adaptation.residual import candidates
from serp.adaptation.residual.candidates import Statistics
from serp.adaptation.residual.fourier import RIDGE, FourierRegression, relative_to
from serp.adaptation.residual.outliers import EXTREME, FAR, FEW, PATIENCE, SETTLED, far_off
from serp.adaptation.residual.solvers import solve_pooled, solve_ridge
from serp.adaptation.residual.warm_up import WarmUp
from serp.model.transition_model import Vector

_FOURIER_FROM, _UNEXPLAINED = 60, 1e-4
"""Random features are used after this many samples if the linear model leaves this fraction of the
squared change."""
_SOLVED_EVERY: Final = 30
"""Weights are solved in every step at first, then after every thirtieth part of the samples."""

Mask = NDArray[np.bool_]


class OnlineResidual:
    """Learns the one-step error of the targets of one group; `parameters` receive the result.

    Attributes:
        siblings: Residuals of other actions with the same inputs and targets, this one included.
    """

    def __init__(
        self,
        group: FeatureGroup,
        parameters: GroupParameters,
        seed: np.random.SeedSequence,
        nonlinear: bool,
    ) -> None:
        depth, count, sets = len(group.inputs), len(group.targets), 1 + MODES
        self._bits = group.bits
        self._warm_up = WarmUp(depth, np.array([group.inputs.index(t) for t in group.targets]))
        self._parameters = parameters
        self._published = parameters.linear, parameters.amplitude, parameters.kinds
        self._fourier = FourierRegression(parameters, depth, count, seed, nonlinear)
        by_set, by_target = (sets, count), (count,)
        self._statistics = Statistics(
            gram=np.zeros((sets, count, 1 + depth, 1 + depth)),
            moment=np.zeros((sets, count, 1 + depth)),
            samples=np.zeros(by_set),
            loss=np.zeros((sets, 4, count)),
            seen=np.zeros(by_set),
            typical=np.zeros(by_set),
            recent=np.zeros(by_target),
            baseline=np.zeros(by_target),
            surprises=np.zeros(by_target),
            streak=np.zeros(by_set),
            spread=np.zeros(by_target),
        )
        self._columns = tuple(self._statistics)  # passed to compiled code faster than a named tuple
        # Sums are of inputs minus the first input: far from 0 the squares would lose precision.
        self._origin = np.zeros(depth)
        self._low = np.full(depth, np.inf)
        self._high = np.full(depth, -np.inf)
        self.siblings: list[OnlineResidual] = [self]
        self._far_inputs = self._samples = self._since_solved = 0

    def learn(self, x: Vector, y: Vector, valid: Mask, change: Vector, enabled: Mask) -> bool:
        """Learn from a sample; return whether any target is predicted by a residual now.

        Args:
            x: `[d]` inputs.
            y: `[T]` observed next values less those of effects and processes.
            valid: `[T]` whether that is observed.
            change: `[T]` observed change.
            enabled: `[T]` whether a residual may predict the target.
        """
        used = self._learn(x, y, valid, change, enabled)
        if not self._warm_up.over:
            self._warm_up.add(x, y, valid, change)
            if self._warm_up.over:
                again = self._learn_warm_up(enabled)
                used = used if again is None else again
        return used

    def track_records(self, schema: str) -> list[TrackRecord]:
        """Return what is known of the residual of each target, after actions of a schema."""
        statistics, parameters = self._statistics, self._parameters
        candidates = [LINEAR, NONLINEAR] if parameters.fourier else [LINEAR]
        loss, seen = statistics.loss[0], statistics.seen[0].tolist()
        used = (parameters.kinds[: 1 + parameters.modes] != FILE).any(axis=0).tolist()
        learned = loss[candidates].min(axis=0).tolist()
        columns = zip(
            used, seen, loss[FILE].tolist(), learned, statistics.spread.tolist(), strict=True
        )
        return [TrackRecord(schema, use, int(steps), *errors) for use, steps, *errors in columns]

    def _learn_warm_up(self, enabled: Mask) -> bool | None:
        """Learn the first samples again without outliers; None if there are no outliers."""
        samples = self._warm_up.without_outliers([group._warm_up for group in self.siblings])
        if samples is None:
            return None
        for array in (*self._statistics, self._origin):
            array[:] = 0.0
        self._low[:], self._high[:] = np.inf, -np.inf
        self._far_inputs = self._samples = self._since_solved = 0
        self._fourier.clear()
        self._parameters.clear_residual()
        return [self._learn(*sample, enabled) for sample in samples][-1]

    def _learn(self, x: Vector, y: Vector, valid: Mask, change: Vector, enabled: Mask) -> bool:
        parameters, statistics, fourier = self._parameters, self._statistics, self._fourier
        if self._is_outlier(x):
            return bool(parameters.kinds.any())
        if not self._samples:
            self._origin[:] = x
        self._samples += 1
        away = x - self._origin
        np.minimum(self._low, x, out=self._low)
        np.maximum(self._high, x, out=self._high)
        evaluated = fourier.evaluate(x)
        mode = self._mode(x)
        complete, changed = candidates.account(
            (x, away, y, valid, change), mode, fourier.features, evaluated, self._published,
            self._columns,
        )  # fmt: skip
        if fourier.enabled:
            if changed:
                fourier.fade()
            if complete:
                fourier.add(x, away, y, evaluated)
        self._since_solved += 1
        if self._since_solved * _SOLVED_EVERY >= self._samples:
            self._since_solved = 0
            # Without a solution the weights are unchanged.
            with contextlib.suppress(np.linalg.LinAlgError):
                self._solve(mode)
        used: bool = candidates.choose(
            statistics.loss, statistics.seen, statistics.spread, parameters.fourier > 0,
            parameters.modes, parameters.kinds, enabled,
        )  # fmt: skip
        return used

    def _is_outlier(self, x: Vector) -> bool:
        """Return whether inputs are far outside their ranges; False after several such in a row."""
        far = False
        if self._samples >= FEW:
            far = far_off(x, self._low, self._high, FAR if self._samples >= SETTLED else EXTREME)
        self._far_inputs = self._far_inputs + 1 if far else 0
        return 0 < self._far_inputs <= PATIENCE

    def _mode(self, x: Vector) -> int:
        """Return the mode of an input, adding a separate model while there is room."""
        if not self._bits:
            return 0
        parameters = self._parameters
        code = float(sum(2**k for k, bit in enumerate(self._bits) if x[bit] != 0.0))
        known = parameters.codes[: 1 + parameters.modes].tolist()
        if code in known[1:]:
            return int(known.index(code, 1))
        if parameters.modes == MODES:
            return 0
        parameters.modes += 1
        parameters.codes[parameters.modes] = code
        parameters.kinds[parameters.modes] = parameters.kinds[0]
        return int(parameters.modes)

    def _solve(self, mode: int) -> None:
        linear, statistics = self._parameters.linear, self._statistics
        centre, half = _centre_and_half(self._low, self._high)
        pooled = self._pooled()
        for row in (0, mode) if mode else (0,):
            # The prior of a mode's weights is the model of all modes.
            prior = relative_to(self._origin, linear[0]) if row else pooled
            solve_ridge(
                statistics.gram[row], statistics.moment[row], statistics.samples[row], self._origin,
                centre, 1.0 / half, RIDGE, prior, linear[row],
            )  # fmt: skip
        if not self._fourier.enabled or not (self._parameters.fourier or self._unexplained()):
            return
        if self._fourier.draw(centre, half, self._origin):
            statistics.loss[:, NONLINEAR] = statistics.loss[:, LINEAR]
        self._fourier.solve(centre, half, self._origin)

    def _pooled(self) -> Vector:
        """Return `[T, 1 + d]` weights from all siblings, each with a separate constant.

        They are weights of the inputs minus the origin. Many changes do not depend on the action,
        so the data of one action are evidence for the others.
        """
        known = [group for group in self.siblings if group._samples]
        low = np.min([group._low for group in known], axis=0)
        high = np.max([group._high for group in known], axis=0)
        centre, half = _centre_and_half(low, high)
        centres = centre - np.array([group._origin for group in known])
        grams = np.array([group._statistics.gram[0] for group in known])
        moments = np.array([group._statistics.moment[0] for group in known])
        found = np.zeros(moments.shape[1:])
        solve_pooled(grams, moments, centres, 1.0 / half, RIDGE, known.index(self), found)
        return found

    def _unexplained(self) -> bool:
        """Return whether linear models leave a large error, and there are enough samples."""
        left = self._statistics.loss[0, LINEAR] > _UNEXPLAINED * self._statistics.spread + 1e-18
        return self._samples >= _FOURIER_FROM and bool(left.any())

    _RANGES: Final = {
        "samples": (0, MOST), "seen": (0, MOST), "streak": (0, MOST), "origin": (-LARGEST, LARGEST),
        "low": (-np.inf, np.inf), "high": (-np.inf, np.inf),  # infinite before the first sample
    }  # fmt: skip
    """Valid ranges; the other sums may overflow for huge observations, which readers handle."""

    def _arrays(self) -> dict[str, Vector]:
        ranges = {"origin": self._origin, "low": self._low, "high": self._high}
        return {**self._statistics._asdict(), **ranges}

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {name: array.copy() for name, array in self._arrays().items()}
        fourier, meta = self._fourier.state_dict()
        arrays |= nested("fourier", fourier) | nested("warm_up", self._warm_up.state_dict())
        return arrays, {
            "fourier": meta,
            "samples": self._samples,
            "since_solved": self._since_solved,
            "far_inputs": self._far_inputs,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the buffer; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        self._samples, self._since_solved = saved.whole("samples"), saved.whole("since_solved")
        self._far_inputs = saved.whole("far_inputs")
        for name, own in self._arrays().items():
            low, high = self._RANGES.get(name, (None, LARGEST))
            own[:] = saved.array(name, np.float64, own.shape, low, high)
        self._fourier.load_state_dict(*saved.part("fourier"))
        self._warm_up.load_state_dict(part_of(arrays, "warm_up"))


def _centre_and_half(low: Vector, high: Vector) -> tuple[Vector, Vector]:
    """Return the centres of ranges and half their widths, 1 for what never changed."""
    centre, half = (high + low) / 2, (high - low) / 2
    half[half <= 1e-9 * np.maximum(1.0, np.abs(centre))] = 1.0
    return centre, half
