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

from serp._core import Regression
from serp._util.saved_state import LARGEST, Arrays, Saved, nested, part_of
from serp.model.learned import residual_features as r
from serp.model.learned.residual_features import Ranges
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

    def __init__(self, count: int) -> None:
        self.block_of = np.zeros(count, dtype=np.int64)
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


Mask = NDArray[np.bool_]

_KEPT: Final = 4096


class KeptSamples:
    """A ring of samples; `d` inputs, `T` targets, of some heads of the regression.

    Attributes:
        x, y, valid: Inputs, errors, and whether these are observed.
        head, weight: Head and weight in the regression.
        seen: Number of samples ever added.
    """

    def __init__(self, depth: int, count: int, heads: int) -> None:
        self.x = np.zeros((_KEPT, depth))
        self.y = np.zeros((_KEPT, count))
        self.valid = np.zeros((_KEPT, count), dtype=np.bool_)
        self.head, self.weight = np.zeros(_KEPT, dtype=np.int64), np.zeros(_KEPT)
        self.seen = 0
        self._heads = heads

    def __len__(self) -> int:
        return min(self.seen, _KEPT)

    def add(self, *sample: Any) -> None:
        """Add a sample: its inputs, errors, whether these are observed, its head and its weight."""
        at = self.seen % _KEPT
        for name, value in zip(self._SAVED, sample, strict=True):
            getattr(self, name)[at] = value
        self.seen += 1

    def newest(self, count: int) -> NDArray[np.int64]:
        """Return the positions of the newest samples, in order of time."""
        return np.arange(self.seen - count, self.seen) % _KEPT

    def age(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how many samples are newer than each of some positions."""
        return (self.seen - 1 - rows) % _KEPT

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return arrays that `load_state_dict` restores exactly."""
        return {name: getattr(self, name)[: len(self)].copy() for name in self._SAVED}

    def load_state_dict(self, saved: Saved, seen: int) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        self.seen = seen
        ranges = {"x": (-LARGEST, LARGEST), "head": (0, self._heads - 1), "weight": (0.0, 1.0)}
        for name in self._SAVED:
            own = getattr(self, name)[: len(self)]
            low, high = ranges.get(name, (None, LARGEST))  # not finite where it is not valid
            own[:] = saved.array(name, own.dtype, own.shape, low, high)

    _SAVED = ("x", "y", "valid", "head", "weight")


REMEMBERED, _FADED = 8, 0.1
"""Newest samples that are believed after a lasting change, and the weight that all others together
keep: where nothing contradicts them they are still the best that is known."""

_PENDING: Final = 32  # samples that are added to the sums at once
_EARLY, _LATER, _COST = 4, 30, 1e6
"""Weights are solved after every 30th part of the samples, or later where it takes long: after as
many samples as this cost goes into the cube of the columns, but after a quarter of the samples."""
_FEATURES_FROM: Final = 60  # samples after which random features may be used
_WIDEST, _NARROWEST = 0.4, 1.2
"""Frequencies are drawn with standard deviations in this range, for normalised inputs: a mixture of
kernels."""
_RIDGE, _HEAD_RIDGE, _CONSTANT_RIDGE, _FEATURE_RIDGE = 1e-3, 0.3, 1e-5, 1e-2
"""Of slopes that all heads share, of those of a head, of constants, and of random features: how
many observations the prior is worth. That actions differ in their constants is likely; that they
differ in slopes has to be seen."""


class FittedWeights:
    """Fits weights to kept samples, and writes them into parameters.

    Attributes:
        kept: The newest samples.
        start: Position of the first sample of the present world.
    """

    def __init__(self, parameters: Regression, seed: np.random.SeedSequence) -> None:
        p = self._parameters = parameters
        self._seed = seed
        self._ranges = Ranges(p.depth)
        self._sums = NormalEquations(p.count)
        self.kept = KeptSamples(p.depth, p.count, p.heads)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._sums.block_of[:] = 0
        self._ranges.clear()
        self.kept.seen = self.start = self._pending = self._since_solved = 0
        self._sums.clear(self._size)

    @property
    def recent(self) -> int:
        """Number of samples of the present world."""
        return self.kept.seen - self.start

    @property
    def _size(self) -> int:
        return int(self._parameters.columns + self._parameters.features)

    def accepts(self, x: Vector) -> bool:
        """Widen the ranges to inputs `[d]`, or return False for an outlier."""
        return self._ranges.accept(x, self.kept.seen)

    def keep(self, x: Vector, y: Vector, valid: Mask, head: int, weight: float) -> None:
        """Keep a sample of a head, with its weight; `update` learns from it."""
        self.kept.add(x, y, valid, head, weight)
        self._pending += 1
        self._since_solved += 1

    def update(self, valid: Mask) -> bool:
        """Learn from the sample that was kept last; return whether weights are to be solved."""
        if not valid[self._sums.block_of == 0].all():
            self._sums.block_of[~valid] = 1
            self._refit()
        if self._pending == _PENDING:
            self._add_pending()
        cost = len(self._sums.gram) * self._size**3 / _COST
        return self._since_solved >= max(self.recent / _LATER, min(self.recent / _EARLY, cost))

    def forget(self) -> None:
        """Believe the newest samples: the present world begins with them."""
        self.start = self.kept.seen - REMEMBERED
        self._refit()

    def _add_pending(self) -> None:
        if self._pending:
            self._add(self.kept.newest(self._pending))
            self._pending = 0

    def _add(self, rows: NDArray[np.int64]) -> None:
        """Add kept samples to the sums: of targets always observed, and of the others."""
        p, kept = self._parameters, self.kept
        weight = kept.weight[rows]
        if self.start:
            age = kept.age(rows) - self.recent
            weight = np.where(age >= 0, weight * (_FADED / len(kept)), weight)
            weight[(age < 0) & (age >= -REMEMBERED)] = 1.0
        weight = np.sqrt(weight)
        design = p.design_matrix(kept.x[rows], kept.head[rows], weight)
        self._sums.add(design, kept.y[rows] * weight[:, None], kept.valid[rows])

    def _refit(self) -> None:
        """Add all kept samples to new sums, with inputs normalised by their ranges."""
        p = self._parameters
        p.centre[:], half = self._ranges.centre_and_half()
        p.shrink[:] = 1.0 / half
        self._pending = 0
        self._sums.clear(self._size)
        known = self.kept.newest(len(self.kept))
        for start in range(0, len(known), 512):
            self._add(known[start : start + 512])

    def solve(self, unexplained: bool) -> bool:
        """Publish the weights; without a finite solution they are unchanged.

        Random features are drawn, and True is returned, if linear models leave something
        `unexplained` and there are enough samples.
        """
        from scipy.linalg import lapack

        p = self._parameters
        self._since_solved = 0
        draws = not p.features and unexplained and self.recent >= _FEATURES_FROM
        if draws:
            self._draw_features()
            self._refit()
        elif self._ranges.beyond(p.centre, p.shrink):
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
        p.phase[:] = random.uniform(0.0, 2.0 * np.pi, r.FEATURES)
        p.features = r.FEATURES

    def _publish(self, kind: int, owned: NDArray[np.int64], weights: Vector) -> None:
        """Publish a solution: weights of each head are those that all share, and its own."""
        p = self._parameters
        blocks = weights[: p.columns].reshape(1 + p.heads, 1 + p.depth, len(owned))
        p.linear[:, kind, owned] = (blocks[0] + blocks[1:]).transpose(0, 2, 1)
        features = weights[p.columns :].T
        if kind:
            p.amplitude[kind - 1, owned, : features.shape[1]] = features

    _SUMS: Final = ("block_of", "gram", "moment")

    def state_dict(self) -> tuple[Arrays, dict[str, float]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {name: getattr(self._sums, name).copy() for name in self._SUMS}
        arrays |= {"low": self._ranges.low.copy(), "high": self._ranges.high.copy()}
        return arrays | nested("kept", self.kept.state_dict()), {
            "start": self.start,
            "pending": self._pending,
            "since_solved": self._since_solved,
            "samples": self.kept.seen,
            "total": self._sums.total,
            "outliers": self._ranges.outliers,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the model; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        seen = saved.whole("samples")
        self.kept.load_state_dict(Saved("residual", part_of(arrays, "kept"), {}), seen)
        self.start, self._pending = saved.whole("start"), saved.whole("pending")
        self._since_solved = saved.whole("since_solved")
        if self.start > seen:
            raise saved.wrong("the last change is later than the last sample")
        if self._pending > min(len(self.kept), _PENDING):
            raise saved.wrong("more samples are pending than there are")
        self._ranges.outliers = saved.whole("outliers")
        for name, end in (("low", self._ranges.low), ("high", self._ranges.high)):
            end[:] = saved.array(name, np.float64, end.shape, -np.inf, np.inf)
        block_of = self._sums.block_of
        block_of[:] = saved.array("block_of", np.int64, block_of.shape, 0, 1)
        self._sums.clear(self._size)
        for name, own in (("gram", self._sums.gram), ("moment", self._sums.moment)):
            own[:] = saved.array(name, np.float64, own.shape)
        self._sums.total = saved.real("total", 0.0)
