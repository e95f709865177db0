"""What a group of views learns online: by how much the file's step is wrong.

Recursive ridge regression of the one-step error of every target, on inputs normalised by their
ranges, linear and, where that leaves something unexplained, beside random Fourier features (Rahimi
& Recht, Random Features for Large-Scale Kernel Machines, 2007). Every candidate is measured on
each sample before it learns from it (prequential loss: Dawid, 1984), and the one that predicts best
is published; the file itself is one of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import LARGEST, MOST, Saved, nested, part_of
from serp.adaptation.feature_groups import FeatureGroup
from serp.adaptation.parameter_buffer import LINEAR, MODES, WAVES, WAVY, GroupMemory
from serp.adaptation.residual import kernels
from serp.adaptation.residual import solvers as solving
from serp.adaptation.residual.outliers import far_off
from serp.adaptation.residual.warm_up import WarmUp
from serp.adaptation.step_kernels import waves_of

Array = NDArray[np.float64]

_RIDGE: Final = 1e-3
_POOLED_RIDGE: Final = 1e-3
_WAVE_RIDGE: Final = 1e-2
_KEPT: Final = 4_000
"""Samples that are kept to begin anew with, when ranges have grown."""
_WAVES_FROM: Final = 60
_UNEXPLAINED: Final = 1e-4
"""Share of the squared change that a linear model may leave unexplained."""
_GROWN: Final = 1.3
"""Random features are drawn anew where a range has grown so much."""
_LENGTH: Final = 1.0
"""Length scale of the random features, in half ranges of the inputs."""
_PER_GROWTH: Final = 30
"""Weights are solved in every step at first, then after every thirtieth part of the samples."""


class OnlineResidual:
    """Learns the one-step error of the targets of one group.

    Args:
        view: Any view of the group.
        memory: Where what predicts best is published.
        seed: Seed of the random features.
        nonlinear: Whether random features may be used.
    """

    def __init__(
        self, view: FeatureGroup, memory: GroupMemory, seed: np.random.SeedSequence, nonlinear: bool
    ) -> None:
        depth, count = len(view.inputs), len(view.targets)
        self._bits = np.array(view.bits, dtype=np.int64)
        self._beginning = WarmUp(depth, np.array([view.inputs.index(t) for t in view.targets]))
        self._memory = memory
        self._nonlinear = nonlinear
        self._random = np.random.default_rng(seed)
        sets, size = 1 + MODES, 1 + depth + WAVES
        self._gram = np.zeros((sets, count, 1 + depth, 1 + depth))
        self._moment = np.zeros((sets, count, 1 + depth))
        self._count = np.zeros((sets, count))
        self._loss = np.zeros((sets, 4, count))
        self._seen = np.zeros((sets, count))
        self._usual, self._streak = np.zeros((2, sets, count))
        self._recent, self._calm, self._odd, self._spread = np.zeros((4, count))
        # Sums are of inputs less the first ones: far from 0 the squares would drown what varies.
        self._origin = np.zeros(depth)
        self._low = np.full(depth, np.inf)
        self._high = np.full(depth, -np.inf)
        self._features = np.zeros(WAVES)
        self._drawn_for = np.zeros((2, depth))  # centre and half range of the inputs
        self._wave_gram = np.zeros((size, size)) if nonlinear else np.zeros((0, 0))
        self._wave_moment = np.zeros((len(self._wave_gram), count))
        self._x = np.zeros((_KEPT if nonlinear else 0, depth))
        self._y = np.zeros((len(self._x), count))
        self.siblings: list[OnlineResidual] = [self]
        """Groups of other actions with the same inputs and targets, this one included."""
        self._kept = 0
        self._strangers = 0
        self._samples = 0
        self._since = 0

    def learn(
        self,
        x: Array,
        y: Array,
        valid: NDArray[np.bool_],
        change: Array,
        enabled: NDArray[np.bool_],
    ) -> bool:
        """Learn from a sample and publish what predicts best.

        Args:
            x: `[d]` inputs.
            y: `[T]` what was observed less effects and processes.
            valid: `[T]` whether that says anything.
            change: `[T]` observed change.
            enabled: `[T]` whether a residual may predict the target at all.

        Returns:
            Whether any target is corrected now.
        """
        corrects = self._learn(x, y, valid, change, enabled)
        if not self._beginning.over:
            self._beginning.add(x, y, valid, change)
            if self._beginning.over:
                again = self._sober(enabled)
                corrects = corrects if again is None else again
        return corrects

    def _sober(self, enabled: NDArray[np.bool_]) -> bool | None:
        """Learn the first samples again without what was wild in them; None where nothing was."""
        samples = self._beginning.without_wild([group._beginning for group in self.siblings])
        if samples is None:
            return None
        self._forget()
        return [self._learn(*sample, enabled) for sample in samples][-1]

    def _learn(
        self,
        x: Array,
        y: Array,
        valid: NDArray[np.bool_],
        change: Array,
        enabled: NDArray[np.bool_],
    ) -> bool:
        memory = self._memory
        if self._strange(x):
            return bool(memory.kinds.any())
        if not self._samples:
            self._origin[:] = x
        self._samples += 1
        away = x - self._origin
        np.minimum(self._low, x, out=self._low)
        np.maximum(self._high, x, out=self._high)
        wavy = memory.waves > 0
        if wavy:
            waves_of(
                x, memory.centre, memory.shrink, memory.frequency, memory.phase, self._features
            )
        mode = self._mode(x)
        complete, changed = kernels.account(
            x, away, y, valid, change, mode, self._features, wavy, memory.linear, memory.amplitude,
            memory.kinds, self._gram, self._moment, self._count, self._loss, self._seen,
            self._usual, self._recent, self._calm, self._odd, self._streak, self._spread,
        )  # fmt: skip
        if changed and self._nonlinear:
            self._wave_gram *= kernels.FORGET
            self._wave_moment *= kernels.FORGET
            self._kept = 0
        if complete and self._nonlinear:
            self._x[self._kept % _KEPT], self._y[self._kept % _KEPT] = x, y
            self._kept += 1
            if wavy:
                solving.accumulate_waves(
                    away, y, self._features, self._wave_gram, self._wave_moment
                )
        self._since += 1
        if self._since * _PER_GROWTH >= self._samples:
            self._since = 0
            # Without a solution the weights stay as they are.
            with contextlib.suppress(np.linalg.LinAlgError):
                self._solve(mode)
        corrects: bool = kernels.choose(
            self._loss, self._seen, self._spread, memory.waves > 0, memory.modes, memory.kinds,
            enabled,
        )  # fmt: skip
        return corrects

    def foresees(self, enabled: NDArray[np.bool_]) -> bool:
        """Whether half of what happens to each target is foreseen, over all siblings.

        By whom does not matter: the file, or a candidate, in use or not. So far as nobody knows
        yet, it is.

        Args:
            enabled: `[T]` whether a residual may predict the target at all.
        """
        left, change = np.zeros((2, len(enabled)))
        for group in self.siblings:
            waves = group._memory.waves > 0
            kernels.judge(group._loss, group._seen, group._spread, waves, enabled, left, change)
        return bool((left <= change).all())

    def _forget(self) -> None:
        """Be as before the first sample; the random features have to be as they were then, too."""
        for name in self._STATE:
            getattr(self, f"_{name}")[:] = 0.0
        self._low[:], self._high[:] = np.inf, -np.inf
        self._kept = self._strangers = self._samples = self._since = 0
        self._memory.unlearn()

    def _strange(self, x: Array) -> bool:
        """Whether inputs are out of all bounds known: one such sample would stretch the ranges.

        Several in a row are believed.
        """
        far = False
        if self._samples >= kernels.FIRST:
            limit = kernels.FAR if self._samples >= kernels.SETTLED else kernels.WILD
            far = far_off(x, self._low, self._high, limit)
        self._strangers = self._strangers + 1 if far else 0
        return 0 < self._strangers <= kernels.PATIENCE

    def _mode(self, x: Array) -> int:
        """Return the mode of an input, giving it a model of its own while there is room."""
        if not len(self._bits):
            return 0
        memory = self._memory
        code, mode = kernels.find_mode(x, self._bits, memory.codes, memory.modes)
        if mode or memory.modes == MODES:
            return int(mode)
        memory.modes += 1
        memory.codes[memory.modes] = code
        memory.kinds[memory.modes] = memory.kinds[0]
        return memory.modes

    def _ranges(self) -> tuple[Array, Array]:
        """Return the centres of the inputs, and half their ranges (1 for what never changed)."""
        return _range(self._low, self._high)

    def _solve(self, mode: int) -> None:
        memory = self._memory
        centre, half = self._ranges()
        prior = self._pooled()
        for row in (0, mode) if mode else (0,):
            # A mode's own weights are drawn to those of all modes.
            drawn_to = _seen_from(self._origin, memory.linear[0]) if row else prior
            solving.solve_linear_targets(
                self._gram[row], self._moment[row], self._count[row], self._origin, centre,
                1.0 / half, _RIDGE, drawn_to, memory.linear[row],
            )  # fmt: skip
        if not self._nonlinear or (not memory.waves and not self._unexplained()):
            return
        if not memory.waves or (half > _GROWN * self._drawn_for[1]).any():
            self._draw_waves(centre, half)
        self._solve_waves(centre, half)

    def _pooled(self) -> Array:
        """Return `[T, 1 + d]` what all actions together say, each with a constant of its own.

        The weights are those of the inputs less the origin.

        Much of what happens, the world does by itself, whatever the action; so what is known of
        one action tells something of the others.
        """
        known = [group for group in self.siblings if group._samples]
        low = np.min([group._low for group in known], axis=0)
        high = np.max([group._high for group in known], axis=0)
        centre, half = _range(low, high)
        centres = centre - np.array([group._origin for group in known])
        grams = np.array([group._gram[0] for group in known])
        moments = np.array([group._moment[0] for group in known])
        found = np.zeros(self._moment.shape[1:])
        own = known.index(self)
        solving.solve_pooled_targets(
            grams, moments, centres, 1.0 / half, _POOLED_RIDGE, own, found
        )  # fmt: skip
        return found

    # Random features ----------------------------------------------------------------------------

    def _unexplained(self) -> bool:
        """Whether linear models leave something to explain, and there are samples to do it."""
        left = self._loss[0, LINEAR] > _UNEXPLAINED * self._spread + 1e-18
        return self._samples >= _WAVES_FROM and bool(left.any())

    def _draw_waves(self, centre: Array, half: Array) -> None:
        """Draw the features for these ranges, and learn again what is still remembered."""
        memory = self._memory
        if not memory.waves:
            memory.frequency[:] = self._random.standard_normal(memory.frequency.shape) / _LENGTH
            memory.phase[:] = self._random.uniform(0.0, 2.0 * np.pi, WAVES)
            self._loss[:, WAVY] = self._loss[:, LINEAR]
        memory.waves = WAVES
        memory.centre[:], memory.shrink[:] = centre, 1.0 / half
        self._drawn_for[:] = centre, half
        self._wave_gram[:] = 0.0
        self._wave_moment[:] = 0.0
        for k in range(min(self._kept, _KEPT)):
            x = self._x[k]
            waves_of(x, centre, memory.shrink, memory.frequency, memory.phase, self._features)
            solving.accumulate_waves(
                x - self._origin, self._y[k], self._features, self._wave_gram, self._wave_moment
            )

    def _solve_waves(self, centre: Array, half: Array) -> None:
        memory, depth = self._memory, len(centre)
        away = centre - self._origin
        matrix = self._wave_gram + np.tril(self._wave_gram, -1).T
        right = self._wave_moment.copy()
        # Statistics of the inputs normalised by their ranges, from those of them as they are.
        linear = slice(1, 1 + depth)
        matrix[linear] = (matrix[linear] - away[:, None] * matrix[0]) / half[:, None]
        matrix[:, linear] = (matrix[:, linear] - matrix[:, :1] * away) / half
        right[linear] = (right[linear] - away[:, None] * right[0]) / half[:, None]
        ridge = np.full(len(matrix), _WAVE_RIDGE)
        ridge[: 1 + depth] = _RIDGE
        matrix[np.diag_indices_from(matrix)] += ridge
        solution = np.linalg.solve(matrix, right)
        solution[linear] /= half[:, None]
        solution[0] -= away @ solution[linear]
        if np.isfinite(solution).all():
            memory.linear[1 + MODES] = _seen_from(-self._origin, solution[: 1 + depth].T)
            memory.amplitude[:] = solution[1 + depth :].T

    # State -------------------------------------------------------------------------------------

    _STATE = (
        "gram", "moment", "count", "loss", "seen", "usual", "recent", "calm", "odd", "streak",
        "spread", "origin", "low", "high", "x", "y", "wave_gram", "wave_moment", "drawn_for",
    )  # fmt: skip
    _RANGES: Final = {
        "count": (0, MOST), "seen": (0, MOST), "streak": (0, MOST),
        "origin": (-LARGEST, LARGEST), "drawn_for": (-LARGEST, LARGEST),
        "low": (-np.inf, np.inf), "high": (-np.inf, np.inf),  # before the first sample
    }  # fmt: skip
    """Where values have to lie. Sums may overflow where observations are wild; who reads them minds
    that."""

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {name: getattr(self, f"_{name}").copy() for name in self._STATE}
        for name in ("x", "y"):
            arrays[name] = arrays[name][: min(self._kept, _KEPT)]
        if not self._memory.waves:
            del arrays["wave_gram"], arrays["wave_moment"]
        arrays |= nested("beginning", self._beginning.state_dict())
        return arrays, {
            "kept": self._kept,
            "samples": self._samples,
            "since": self._since,
            "strangers": self._strangers,
            "random": self._random.bit_generator.state,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; what was published is restored by its owner, before.

        Raises:
            RunError: It belongs to another view, or is damaged.
        """
        saved = Saved("residual", arrays, meta)
        self._kept, self._samples = saved.whole("kept"), saved.whole("samples")
        self._since, self._strangers = saved.whole("since"), saved.whole("strangers")
        self._random.bit_generator.state = saved.generator_state("random", self._random)
        for name in self._STATE:
            own = getattr(self, f"_{name}")
            if name.startswith("wave") and not self._memory.waves:
                own[:] = 0.0
                continue
            rows = min(self._kept, len(own)) if name in ("x", "y") else len(own)
            low, high = self._RANGES.get(name, (None, LARGEST))
            own[:rows] = saved.array(name, np.float64, (rows, *own.shape[1:]), low, high)
        self._beginning.load_state_dict(part_of(arrays, "beginning"))


def _range(low: Array, high: Array) -> tuple[Array, Array]:
    centre, half = (high + low) / 2, (high - low) / 2
    half[half <= 1e-9 * np.maximum(1.0, np.abs(centre))] = 1.0
    return centre, half


def _seen_from(origin: Array, weights: NDArray[np.floating[Any]]) -> Array:
    """Return what weights `[T, 1 + d]` of inputs are as weights of the inputs less an origin."""
    seen = np.array(weights, dtype=np.float64)
    seen[:, 0] += weights[:, 1:] @ origin
    return seen
