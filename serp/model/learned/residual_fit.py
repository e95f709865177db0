"""The weights of a residual: one Bayesian linear regression of all actions that share it.

The design matrix has a constant and the inputs, the same for every head (action schema) and of each
head, and random Fourier features that all heads share (Rahimi & Recht, NeurIPS 2007). The prior of
all weights is normal about 0, so that a head differs from the others only as its samples say.
Features are in order of smoothness: one Cholesky factor solves all sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._core import Regression, RegressionSamples
from serp._util.saved_state import LARGEST, Arrays, Saved, nested, part_of
from serp.model.learned import feature_groups as r
from serp.model.transition_model import Vector


class NormalEquations:
    """Sums of the rows of a design matrix of D columns, for T targets.

    Targets that are always observed share one matrix; the others have another one.

    Attributes:
        block_of: `[T]` the matrix of each target, 0 or 1.
        gram: `[blocks, D, D]`.
        moment: `[D, T]`.
        total: Rows in the sums.
    """

    def __init__(self, block_of: NDArray[np.int64]) -> None:
        self.block_of = block_of
        self.clear(0)

    def clear(self, size: int) -> None:
        """Begin with no rows of `size` columns."""
        self.gram = np.zeros((1 + int(self.block_of.max(initial=0)), size, size))
        self.moment = np.zeros((size, len(self.block_of)))
        self.total = 0.0

    def add(self, design: Vector, targets: Vector, valid: NDArray[np.bool_]) -> None:
        """Add rows; `valid` `[n, T]` says which targets were observed."""
        for block in range(len(self.gram)):
            owned = self.block_of == block
            if not owned.any():
                continue
            usable = valid[:, owned].all(axis=1)
            some = design if usable.all() else design[usable]
            self.gram[block] += some.T @ some
            self.moment[:, owned] += some.T @ targets[usable][:, owned]
        self.total += len(design)
        if self.total > 8192.0:  # older samples lose half of their weight
            self.total *= 0.5
            self.gram *= 0.5
            self.moment *= 0.5

    def solutions(
        self, ridge: Vector, sizes: Sequence[int]
    ) -> Iterator[tuple[NDArray[np.int64], list[Vector], Vector]]:
        """Yield targets, their weights by the first columns of each size, and the Cholesky factor.

        Nothing is yielded for a matrix without a finite solution.
        """
        from scipy.linalg import lapack

        for block, gram in enumerate(self.gram):
            owned = np.flatnonzero(self.block_of == block)
            if not len(owned):
                continue
            matrix = gram.copy()
            matrix[np.diag_indices_from(matrix)] += ridge
            factor, failed = lapack.dpotrf(matrix, lower=1)
            if failed:
                continue
            half, _ = lapack.dtrtrs(factor, self.moment[:, owned], lower=1)
            weights = [lapack.dtrtrs(factor[:n, :n], half[:n], lower=1, trans=1)[0] for n in sizes]
            if all(np.isfinite(each).all() for each in weights):
                yield owned, weights, factor


_FADED: Final = 0.1
"""The weight that all samples together keep after a lasting change, but for the newest: where
nothing contradicts them they are still the best that is known."""

_FEATURES_FROM: Final = 60  # samples after which random features may be used
_WIDEST, _NARROWEST = 0.4, 1.2
"""Frequencies are drawn with standard deviations in this range, for normalised inputs: a mixture of
kernels."""
_RIDGE, _HEAD_RIDGE, _CONSTANT_RIDGE, _FEATURE_RIDGE = 1e-3, 0.3, 1e-5, 1e-2
"""Of slopes that all heads share, of those of a head, of constants, and of random features: how
many observations the prior is worth. That actions differ in their constants is likely; that they
differ in slopes has to be seen."""


class FittedWeights:
    """Fits weights to samples, and writes them into the parameters of the regression.

    There are so many random `features`; they do not depend on the `alone` last inputs.
    """

    def __init__(
        self, parameters: Regression, samples: RegressionSamples, seed: np.random.SeedSequence,
        alone: int = 0, features: int = r.FEATURES,
    ) -> None:  # fmt: skip
        self._parameters, self._samples = parameters, samples
        self._seed = seed
        self._alone, self._features = alone, features
        self._sums = NormalEquations(samples.block_of)
        self.reset()

    def reset(self) -> None:
        """Forget everything, after the samples."""
        self._sums.clear(self._size)

    @property
    def _size(self) -> int:
        return int(self._parameters.columns + self._parameters.features)

    def update(self) -> bool:
        """Learn from the sample that was kept last; return whether weights are to be solved."""
        samples = self._samples
        block_of = samples.block_of
        valid = samples.rows(samples.number - 1, samples.number)[2][0] == 1
        if not valid[block_of == 0].all():
            block_of[~valid] = 1
            self._refit()
        if samples.pending >= RegressionSamples.PENDING:
            self._add_pending()
        return samples.solution_due()

    def forget(self) -> None:
        """Believe the newest samples: the present world begins with them."""
        self._samples.start = self._samples.number - RegressionSamples.REMEMBERED
        self._refit()

    def _add_pending(self) -> None:
        samples = self._samples
        if samples.pending:
            self._add(samples.number - samples.pending, samples.number)
            samples.pending = 0

    def _add(self, first: int, last: int) -> None:
        """Add samples to the sums: of targets always observed, and of the others."""
        samples, start = self._samples, self._samples.start
        x, y, valid, head, weight = samples.rows(first, last)
        if start:
            number = np.arange(first, last)
            weight = np.where(number < start, weight * (_FADED / samples.kept), weight)
            weight[(number >= start) & (number < start + RegressionSamples.REMEMBERED)] = 1.0
        weight = np.sqrt(weight)
        design = self._parameters.design_matrix(x, head, weight)
        self._sums.add(design, y * weight[:, None], valid == 1)

    def _refit(self) -> None:
        """Add all kept samples to new sums, with inputs normalised by their ranges."""
        p, samples = self._parameters, self._samples
        p.centre[:], half = samples.centre_and_half()
        p.shrink[:] = 1.0 / half
        samples.pending = 0
        self._sums.clear(self._size)
        for first in range(samples.number - samples.kept, samples.number, 512):
            self._add(first, min(first + 512, samples.number))

    def _out_of_range(self) -> bool:
        """Return whether a range is much wider than the one that inputs are normalised by."""
        p, samples = self._parameters, self._samples
        ends = np.maximum(samples.high - p.centre, p.centre - samples.low) * p.shrink
        return not p.shrink.all() or bool((ends > r.RANGE).any())

    def solve(self, unexplained: bool) -> bool:
        """Publish the weights; without a finite solution they are unchanged.

        Random features are drawn, and True is returned, if linear models leave something
        `unexplained` and there are enough samples.
        """
        from scipy.linalg import lapack

        p, samples = self._parameters, self._samples
        samples.since_solved = 0
        recent = samples.number - samples.start
        draws = not p.features and unexplained and recent >= _FEATURES_FROM
        if draws:
            self._draw_features()
            self._refit()
        elif self._out_of_range():
            self._refit()
        self._add_pending()
        linear, smooth = p.columns, p.columns + r.SMOOTH
        sizes = (linear, smooth, self._size) if p.features else (linear,)
        ridge = np.full(self._size, _HEAD_RIDGE)
        ridge[: 1 + p.depth] = _RIDGE
        ridge[: linear : 1 + p.depth] = _CONSTANT_RIDGE
        ridge[linear:] = _FEATURE_RIDGE
        for owned, weights, factor in self._sums.solutions(ridge, sizes):
            for kind, each in enumerate(weights):
                self._publish(kind, owned, each)
            if 0 in owned:
                p.known = known = sizes[:2][-1]
                inverse, _ = lapack.dtrtri(factor[:known, :known], lower=1)
                p.inverse[:known, :known] = inverse.T
        return draws

    def _draw_features(self) -> None:
        """Draw random features, the smoothest first."""
        p, random = self._parameters, np.random.default_rng(self._seed)
        width = np.exp(random.uniform(np.log(_WIDEST), np.log(_NARROWEST), r.FEATURES))
        frequency = width * random.standard_normal(p.frequency.shape)
        order = np.argsort((frequency**2).sum(axis=0), kind="stable")
        p.frequency[:] = frequency[:, order]
        p.frequency[p.depth - self._alone :] = 0.0
        p.phase[:] = random.uniform(0.0, 2.0 * np.pi, r.FEATURES)
        p.features = self._features

    def _publish(self, kind: int, owned: NDArray[np.int64], weights: Vector) -> None:
        """Publish a solution: weights of each head are those that all share, and its own."""
        p = self._parameters
        blocks = weights[: p.columns].reshape(1 + p.heads, 1 + p.depth, len(owned))
        p.linear[:, kind, owned] = (blocks[0] + blocks[1:]).transpose(0, 2, 1)
        features = weights[p.columns :].T
        if kind:
            p.amplitude[kind - 1, owned, : features.shape[1]] = features

    _SUMS: Final = "gram", "moment"
    _ENDS: Final = "low", "high"
    _ROWS: Final = "x", "y", "valid", "head", "weight"
    _COUNTS: Final = "start", "pending", "since_solved", "outliers", "alarms", "of_episode"

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        samples, number = self._samples, self._samples.number
        arrays: Arrays = {name: getattr(self._sums, name).copy() for name in self._SUMS}
        arrays |= {name: getattr(samples, name).copy() for name in ("block_of", *self._ENDS)}
        rows: Any = zip(self._ROWS, samples.rows(number - samples.kept, number), strict=True)
        kept = {name: np.roll(row, self._oldest(number), 0) for name, row in rows}
        kept["valid"] = kept["valid"] == 1
        meta = {name: getattr(samples, name) for name in self._COUNTS}
        meta |= {"samples": number, "total": self._sums.total}
        return arrays | nested("kept", kept), meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the model; `RunError` if it does not fit."""
        p, samples = self._parameters, self._samples
        saved = Saved("residual", arrays, meta)
        counts = {name: saved.whole(name) for name in self._COUNTS}
        number = saved.whole("samples")
        size = min(number, RegressionSamples.KEPT)
        if counts["start"] > number:
            raise saved.wrong("the last change is later than the last sample")
        if counts["pending"] > min(size, RegressionSamples.PENDING):
            raise saved.wrong("more samples are pending than there are")
        rows = Saved("residual", part_of(arrays, "kept"), {})
        kept: tuple[NDArray[Any], ...] = (
            rows.array("x", np.float64, (size, p.depth), -LARGEST, LARGEST),
            rows.array("y", np.float64, (size, p.count), None, LARGEST),  # NaN where not valid
            rows.array("valid", np.bool_, (size, p.count)).astype(np.uint8),
            rows.array("head", np.int64, (size,), 0, p.heads - 1),
            rows.array("weight", np.float64, (size,), 0.0, 1.0),
        )
        samples.restore(number, *(np.roll(row, -self._oldest(number), 0) for row in kept))
        for name, value in counts.items():
            setattr(samples, name, value)
        for name in self._ENDS:
            end = getattr(samples, name)
            end[:] = saved.array(name, np.float64, end.shape, -np.inf, np.inf)
        samples.block_of[:] = saved.array("block_of", np.int64, samples.block_of.shape, 0, 1)
        self._sums.clear(self._size)
        for name in self._SUMS:
            own = getattr(self._sums, name)
            own[:] = saved.array(name, np.float64, own.shape)
        self._sums.total = saved.real("total", 0.0)

    @staticmethod
    def _oldest(number: int) -> int:
        """Return the saved position of the oldest sample; they are saved as a ring."""
        return number % RegressionSamples.KEPT if number > RegressionSamples.KEPT else 0
