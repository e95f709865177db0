"""Online learning of the one-step error of the file: who predicts, and when the world has changed.

Each sample is first predicted, then learned from. By these predictions the predictor of each target
is chosen, outliers lose weight (errors have Student's t distribution), and a lasting change of the
world is noticed: then all but the newest samples are forgotten.

The weights are those of one Bayesian linear regression of all actions that share it. The design
matrix has a constant and the inputs, the same for every head (action schema) and of each head, and
random Fourier features that all heads share (Rahimi & Recht, NeurIPS 2007). The prior of all
weights is normal about 0, so that a head differs from the others only as its samples say. Features
are in order of smoothness: one Cholesky factor solves all sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._core import ObservedStep, Regression, RegressionSamples
from serp._util.saved_state import LARGEST, MOST, Arrays, Saved
from serp.model.learned import feature_groups as r
from serp.model.learned.adoption import Reliability, TrackRecord, WorthAdoption
from serp.model.transition_model import Vector
from serp.pddl.syntax import REWARD, TERMINAL


class NormalEquations:
    """Sums of the rows of a design matrix of D columns, for T targets.

    Targets that are always observed share one matrix; the others have another one: `block_of` `[T]`
    is the matrix of each target, 0 or 1. `gram` is `[blocks, D, D]`, `moment` `[D, T]`.
    """

    def __init__(self, block_of: NDArray[np.int64], size: int) -> None:
        self.block_of = block_of
        self.clear(size)

    def clear(self, size: int) -> None:
        """Begin with no rows of `size` columns."""
        blocks = 1 + int(self.block_of.max(initial=0))
        self._owned = [np.flatnonzero(self.block_of == block) for block in range(blocks)]
        self.gram = np.zeros((blocks, size, size))
        self.moment = np.zeros((size, len(self.block_of)))
        self.total = 0.0

    def add(self, design: Vector, targets: Vector, valid: NDArray[np.bool_]) -> None:
        """Add rows; `valid` `[n, T]` says which targets were observed."""
        for gram, owned in zip(self.gram, self._owned, strict=True):
            if not len(owned):
                continue
            usable = valid[:, owned].all(axis=1)
            some, wanted = design, targets
            if not usable.all():
                some, wanted = design[usable], targets[usable]
            gram += some.T @ some
            self.moment[:, owned] += some.T @ wanted[:, owned]
        self.total += len(design)
        if self.total > 8192.0:  # older samples lose half of their weight
            self.total *= 0.5
            self.gram *= 0.5
            self.moment *= 0.5

    def solutions(
        self, ridge: Vector, sizes: Sequence[int]
    ) -> Iterator[tuple[NDArray[np.int64], list[Vector], Vector]]:
        """Yield targets, weights by the first columns of each size, and the Cholesky factor."""
        from scipy.linalg import lapack

        for gram, owned in zip(self.gram, self._owned, strict=True):
            if not len(owned):
                continue
            matrix = gram.copy()
            matrix.ravel()[:: len(ridge) + 1] += ridge
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


class ResidualRegression:
    """Learns the one-step error of the targets of alike groups; `parameters` receive the result."""

    _SQUARED = False
    """Whether the errors by which predictors are chosen are squared."""
    _ALONE = 0
    _FEATURES = r.FEATURES
    """Number of the last inputs that random features do not depend on, and of these features."""

    def __init__(self, parameters: Regression, seed: np.random.SeedSequence) -> None:
        parameters.clear()
        self._parameters = parameters
        self._seed = seed
        self._samples = RegressionSamples(parameters, self._SQUARED)
        self._sums = NormalEquations(self._samples.block_of, parameters.columns)

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
        self._update(self._samples.learn(head, step, inputs, targets, whole))

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

    def _update(self, due: int) -> None:
        """Do what is due after the newest sample."""
        if due == RegressionSamples.NOTHING:
            return
        samples, block_of = self._samples, self._samples.block_of
        if due == RegressionSamples.FORGET:
            self._forget()
        valid = samples.valid[(samples.number - 1) % RegressionSamples.KEPT] == 1
        if not valid[block_of == 0].all():
            block_of[~valid] = 1
            self._refit()
        if samples.pending >= RegressionSamples.PENDING:
            self._add_pending()
        if samples.solution_due():
            self._solve()
        samples.choose()

    def _forget(self) -> None:
        """Forget all but the newest samples, because the environment has changed."""
        p, samples = self._parameters, self._samples
        p.features = p.known = 0
        p.typical[:] = 0.0
        samples.clear_errors()
        samples.start = samples.number - RegressionSamples.REMEMBERED
        self._refit()
        self._solve()

    @property
    def _size(self) -> int:
        return int(self._parameters.columns + self._parameters.features)

    def _add_pending(self) -> None:
        samples = self._samples
        if samples.pending:
            self._add(samples.number - samples.pending, samples.number)
            samples.pending = 0

    def _add(self, first: int, last: int) -> None:
        """Add samples to the sums: of targets always observed, and of the others."""
        samples, start = self._samples, self._samples.start
        number = np.arange(first, last)
        at = number % RegressionSamples.KEPT
        weight = samples.weight[at]
        if start:
            kept = min(samples.number, RegressionSamples.KEPT)
            weight = np.where(number < start, weight * (_FADED / kept), weight)
            weight[(number >= start) & (number < start + RegressionSamples.REMEMBERED)] = 1.0
        weight = np.sqrt(weight)
        design = self._parameters.design_matrix(samples.x[at], samples.head[at], weight)
        self._sums.add(design, samples.y[at] * weight[:, None], samples.valid[at] == 1)

    def _refit(self) -> None:
        """Add all kept samples to new sums, with inputs normalised by their ranges."""
        samples, last = self._samples, self._samples.number
        samples.normalise()
        samples.pending = 0
        self._sums.clear(self._size)
        for first in range(max(0, last - RegressionSamples.KEPT), last, 512):
            self._add(first, min(first + 512, last))

    def _out_of_range(self) -> bool:
        """Return whether a range is much wider than the one that inputs are normalised by."""
        p, samples = self._parameters, self._samples
        ends = np.maximum(samples.high - p.centre, p.centre - samples.low) * p.shrink
        return not p.shrink.all() or bool((ends > r.RANGE).any())

    def _solve(self) -> None:
        """Publish the weights; without a finite solution they are unchanged.

        Random features are drawn where the linear model leaves a hundredth of the change and there
        are enough samples.
        """
        from scipy.linalg import lapack

        p, samples, loss = self._parameters, self._samples, self._samples.loss
        samples.since_solved = 0
        least = 0.01 * samples.spread
        left = loss[r.LINEAR] > (least**2 if self._SQUARED else least) + 1e-18
        if not p.features and left.any() and samples.number - samples.start >= _FEATURES_FROM:
            self._draw_features()
            self._refit()
            loss[r.LINEAR + 1 :] = loss[r.LINEAR]
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

    def _draw_features(self) -> None:
        """Draw random features, the smoothest first."""
        p, random = self._parameters, np.random.default_rng(self._seed)
        width = np.exp(random.uniform(np.log(_WIDEST), np.log(_NARROWEST), r.FEATURES))
        frequency = width * random.standard_normal(p.frequency.shape)
        order = np.argsort((frequency**2).sum(axis=0), kind="stable")
        p.frequency[:] = frequency[:, order]
        p.frequency[p.depth - self._ALONE :] = 0.0
        p.phase[:] = random.uniform(0.0, 2.0 * np.pi, r.FEATURES)
        p.features = self._FEATURES

    def _publish(self, kind: int, owned: NDArray[np.int64], weights: Vector) -> None:
        """Publish a solution: weights of each head are those that all share, and its own."""
        p = self._parameters
        blocks = weights[: p.columns].reshape(1 + p.heads, 1 + p.depth, len(owned))
        p.linear[:, kind, owned] = (blocks[0] + blocks[1:]).transpose(0, 2, 1)
        features = weights[p.columns :].T
        if kind:
            p.amplitude[kind - 1, owned, : features.shape[1]] = features

    _BOUNDS: Final[Mapping[str, tuple[float | None, float]]] = {
        "seen": (0, MOST), "samples": (0, MOST), "surprises": (0.0, 1.0),
        "loss": (0.0, np.inf), "doubt": (0.0, np.inf), "spread": (0.0, np.inf),
        "reliability": (0.0, MOST), "low": (-np.inf, np.inf), "high": (-np.inf, np.inf),
        "block_of": (0, 1), "y": (None, LARGEST),  # NaN where not valid
        "valid": (0, 1), "weight": (0.0, 1.0),
    }  # fmt: skip
    """Least and largest values; other numbers are finite."""
    _OF_SAMPLES: Final = (
        "loss", "doubt", "seen", "spread", "samples", "surprises", "reliability", "low", "high",
        "block_of",
    )  # fmt: skip
    _ROWS: Final = "x", "y", "valid", "head", "weight"
    _COUNTS: Final = (
        "number", "start", "pending", "since_solved", "outliers", "alarms", "of_episode",
    )  # fmt: skip

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        meta = {name: getattr(self._samples, name) for name in self._COUNTS}
        meta |= {"features": self._parameters.features, "known": self._parameters.known}
        sums = {"gram": self._sums.gram.copy(), "moment": self._sums.moment.copy()}
        own = {name: array.copy() for name, array in self._arrays().items()}
        return {"kinds": self._parameters.kinds, **sums, **own}, meta | {"total": self._sums.total}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; `RunError` if it does not fit."""
        p, samples, saved = self._parameters, self._samples, Saved("residual", arrays, meta)
        counts = {name: saved.whole(name) for name in self._COUNTS}
        if counts["start"] > counts["number"]:
            raise saved.wrong("the last change is later than the last sample")
        if counts["pending"] > min(counts["number"], RegressionSamples.PENDING):
            raise saved.wrong("the number of pending samples is too large")
        for name, value in counts.items():
            setattr(samples, name, value)
        try:
            p.features = saved.whole("features", 0, r.FEATURES)
            p.known = saved.whole("known", 0, p.columns + r.SMOOTH)
        except ValueError as error:
            raise saved.wrong(str(error)) from None
        p.kinds = saved.array("kinds", np.int64, p.kinds.shape, r.FILE, r.FULL)
        bounds = {**self._BOUNDS, "head": (0, p.heads - 1)}
        for name, own in self._arrays().items():
            own[:] = saved.array(name, own.dtype, own.shape, *bounds.get(name, ()))
        self._sums.clear(self._size)  # as many as there are blocks
        for own, name in ((self._sums.gram, "gram"), (self._sums.moment, "moment")):
            own[:] = saved.array(name, own.dtype, own.shape)
        self._sums.total = saved.real("total", 0.0)

    def _arrays(self) -> Arrays:
        """Return views of weights and samples, by their names in a checkpoint."""
        samples, size = self._samples, min(self._samples.number, RegressionSamples.KEPT)
        return {
            **{name: getattr(self._parameters, name) for name in r.WEIGHTS},
            **{name: getattr(samples, name) for name in self._OF_SAMPLES},
            **{name: getattr(samples, name)[:size] for name in self._ROWS},
        }


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
        self._update(self._samples.learn_worth(head, step, rewarded))

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
