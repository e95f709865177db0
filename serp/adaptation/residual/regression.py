"""Online learning of the one-step error of the file: one Bayesian linear regression.

The design matrix has a constant and the inputs, the same for every row (action schema, or schema
and values of predicates) and of each row, and random Fourier features that all rows share (Rahimi &
Recht, NeurIPS 2007). The prior of all weights is normal about 0, so that a row differs from the
others only as its samples say. Errors have Student's t distribution, so that outliers have little
weight. Features are in order of smoothness: one Cholesky factor solves all sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from serp._util.saved_state import MOST, Saved, nested, part_of
from serp.adaptation.adoption import TrackRecord
from serp.adaptation.feature_groups import FeatureGroup
from serp.adaptation.residual import evidence as e
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.design import design_matrix, predicted
from serp.adaptation.residual.first_samples import FIRST, outliers
from serp.adaptation.residual.kept_samples import KeptSamples, Mask
from serp.adaptation.residual.normal_equations import NormalEquations
from serp.adaptation.residual.parameters import RegressionParameters
from serp.adaptation.residual.ranges import Ranges
from serp.adaptation.residual.records import track_records
from serp.model.transition_model import Vector

_PENDING: Final = 32  # samples that are added to the sums at once
_REMEMBERED, _FADED = 8, 0.1
"""Newest samples that are believed after a lasting change, and the weight that all others together
keep: where nothing contradicts them they are still the best that is known."""
_LONG: Final = 24
"""A change is lasting if it goes on in the next episode, or for so many steps: not an impact, nor
what a robot meets at the end of an episode only."""
_RECONSIDERED: Final = (32, 64, 128, 256, 512)  # samples after a change: was there one?
_EARLY, _LATER, _COST = 4, 30, 1e6
"""Weights are solved after every 30th part of the samples, or later where it takes long: after as
many samples as this cost goes into the cube of the columns, but after a quarter of the samples."""
_FEATURES_FROM, _UNEXPLAINED = 60, 1e-2
"""Random features are used after this many samples if the linear model leaves this fraction of the
change."""
_RIDGE, _ROW_RIDGE, _CONSTANT_RIDGE, _FEATURE_RIDGE = 1e-3, 3e-2, 1e-5, 1e-2
"""Of slopes that all rows share, of those of a row, of constants, and of random features."""


class ResidualRegression:
    """Learns the one-step error of the targets of alike groups; `parameters` receive the result."""

    def __init__(
        self,
        group: FeatureGroup,
        parameters: RegressionParameters,
        seed: np.random.SeedSequence,
    ) -> None:
        p = self._parameters = parameters
        depth, count, rows = p.depth, p.count, p.rows
        self._bits, self._seed = group.bits, seed
        self._places = np.array([group.inputs.index(t) for t in group.targets], dtype=np.int64)
        self._published = (
            p.centre, p.shrink, p.frequency, p.phase, p.linear, p.amplitude, p.kinds, p.inverse,
            p.typical, p.scale,
        )  # fmt: skip
        self._loss, self._samples = np.zeros((4, count)), np.zeros((rows, count))
        self._seen, self._spread, self._surprises = np.zeros(count), np.zeros(count), np.zeros(1)
        self._own = np.zeros((rows, 3, count))
        self._statistics = (
            self._loss, self._seen, self._spread, self._own, self._samples, self._surprises,
        )  # fmt: skip
        self._shelved = [np.zeros_like(array) for array in self._statistics]
        self._ranges = Ranges(depth)
        self._sums = NormalEquations(count)
        self._kept = KeptSamples(depth, count, rows)
        self._before = RegressionParameters(np.zeros(p.all.size), 0, group, p.heads)
        self._firsts = np.zeros(p.heads, dtype=np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget everything but the number of first samples."""
        self._parameters.clear()
        for array in (*self._statistics, self._sums.block_of):
            array[:] = 0
        self._ranges.clear()
        self._kept.seen = self._start = self._pending = self._since_solved = 0
        self._alarms, self._of_episode = 0, _REMEMBERED
        self._sums.clear(self._size)

    @property
    def _size(self) -> int:
        return int(self._parameters.columns + self._parameters.features)

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
        valid = valid & (np.abs(y) < e.HUGE)
        used = self._learn(head, x, y, valid, change, enabled)
        self._firsts[head] += 1
        if self._firsts[head] == FIRST:
            return self._drop_outliers(head, enabled, used)
        return used

    def begin_episode(self) -> None:
        """Note that the next sample is of another episode."""
        self._of_episode = 0

    def track_records(self, schema: str, head: int) -> list[TrackRecord]:
        """Return what is known of the residual of each target, after actions of a schema."""
        p = self._parameters
        steps = self._samples[p.head_of_rows == head].sum(axis=0)
        return track_records(schema, p, self._loss, steps, self._spread)

    def _drop_outliers(self, head: int, enabled: Mask, used: bool) -> bool:
        """Learn again without the outliers among the first samples of a head."""
        kept = self._kept
        known, heads = kept.newest(len(kept)), self._parameters.head_of_rows
        own = known[heads[kept.row[known]] == head]
        if not len(own):
            return used
        dropped, usable = outliers(
            kept.x[own], kept.x[known], kept.y[own], kept.valid[own], self._places
        )
        if not dropped.any() and (usable == kept.valid[own]).all():
            return used
        kept.valid[own] = usable
        again = known[~np.isin(known, own[dropped])]
        of = heads[kept.row[again]].tolist()
        samples = [part[again] for part in (kept.x, kept.y, kept.valid, kept.change)]
        self.reset()
        for head, x, y, valid, change in zip(of, *samples, strict=True):
            used = self._learn(head, x, y, valid, change, enabled)
        return used

    def _learn(
        self, head: int, x: Vector, y: Vector, valid: Mask, change: Vector, enabled: Mask
    ) -> bool:
        p = self._parameters
        if not valid.any() or not self._ranges.accept(x, self._kept.seen):
            return bool(p.kinds.any())
        row = self._row(head, x)
        weight, changed = e.account(
            (x, y, valid, change), row, head, self._published,
            (p.features, p.known, p.columns, p.heads), self._statistics,
        )  # fmt: skip
        self._kept.add(x, y, valid, change, (row, weight))
        self._pending += 1
        self._since_solved += 1
        self._of_episode += 1
        recent = self._kept.seen - self._start
        self._alarms = self._alarms + 1 if changed else 0
        if changed and (self._of_episode < _REMEMBERED or self._alarms > _LONG):
            self._forget()
        elif self._start and recent in _RECONSIDERED:
            self._reconsider()
        if not valid[self._sums.block_of == 0].all():
            self._sums.block_of[~valid] = 1
            self._refit()
        if self._pending == _PENDING:
            self._add_pending()
        cost = len(self._sums.gram) * self._size**3 / _COST
        if self._since_solved >= max(recent / _LATER, min(recent / _EARLY, cost)):
            self._solve()
        used: bool = e.choose(self._statistics, p.features > 0, p.kinds, enabled)
        return used

    def _row(self, head: int, x: Vector) -> int:
        """Return the row of an input, adding a mode while there is room."""
        if not self._bits:
            return head
        p = self._parameters
        bits = sum(2**k for k, bit in enumerate(self._bits) if x[bit] != 0.0)
        code = float(r.CODES * head + bits)
        known: list[float] = p.codes[p.heads : p.heads + p.modes].tolist()
        if code in known:
            return p.heads + known.index(code)
        if p.heads + p.modes == p.rows:
            return head
        row: int = p.heads + p.modes
        p.modes += 1
        p.codes[row] = code
        p.linear[row] = p.linear[head]
        return row

    def _forget(self) -> None:
        """Forget all but the newest samples, because the environment has changed."""
        p = self._parameters
        self._before.restore(p.contents())
        p.features = p.known = 0
        p.kinds[:] = np.minimum(p.kinds, r.LINEAR)
        p.typical[:] = 0.0
        for array, shelved in zip(self._statistics, self._shelved, strict=True):
            shelved[:] = array
            array[:] = 0.0
        self._begin(self._kept.seen - _REMEMBERED)

    def _begin(self, start: int) -> None:
        """Believe the samples since the start of the present world, a position."""
        self._start = start
        self._refit()
        self._solve()

    def _reconsider(self) -> None:
        """Believe older samples again if what was learned from them predicts the new ones better.

        The new errors are those of the samples when they were new, so both are predictions.
        """
        p, kept = self._parameters, self._kept
        new = kept.newest(kept.seen - self._start)
        off = np.abs(kept.y[new] - predicted(self._before, kept.x[new], kept.row[new]))
        now, balance = p.typical[kept.row[new]].mean(axis=0), 0.0
        for t in np.flatnonzero((self._before.kinds > 0) & (p.scale[1] > 0)):
            usual = off[kept.valid[new, t], t]
            balance += (np.median(usual) - now[t]) / p.scale[1, t] if len(usual) else 0.0
        if balance < 0.0:
            p.restore(self._before.contents())
            for array, shelved in zip(self._statistics, self._shelved, strict=True):
                array[:] = shelved
            self._surprises[:] = 0.0
            self._begin(0)

    def _add_pending(self) -> None:
        if self._pending:
            self._add(self._kept.newest(self._pending))
            self._pending = 0

    def _add(self, rows: NDArray[np.int64]) -> None:
        """Add kept samples to the sums: of targets always observed, and of the others."""
        p, kept = self._parameters, self._kept
        weight = kept.weight[rows]
        if self._start:
            age = kept.age(rows) - (kept.seen - self._start)
            weight = np.where(age >= 0, weight * (_FADED / len(kept)), weight)
            weight[(age < 0) & (age >= -_REMEMBERED)] = 1.0
        weight = np.sqrt(weight)
        design = design_matrix(p, kept.x[rows], kept.row[rows], weight)
        self._sums.add(design, kept.y[rows] * weight[:, None], kept.valid[rows])

    def _refit(self) -> None:
        """Add all kept samples to new sums, with inputs normalised by their ranges."""
        p = self._parameters
        p.centre[:], half = self._ranges.centre_and_half()
        p.shrink[:] = 1.0 / half
        self._pending = 0
        self._sums.clear(self._size)
        known = self._kept.newest(len(self._kept))
        for start in range(0, len(known), 512):
            self._add(known[start : start + 512])

    def _solve(self) -> None:
        """Publish the weights; without a finite solution they are unchanged."""
        p = self._parameters
        self._since_solved = 0
        if not p.features and self._unexplained():
            p.draw(self._seed)
            self._loss[r.LINEAR + 1 :] = self._loss[r.LINEAR]
            self._refit()
        elif self._ranges.beyond(p.centre, p.shrink):
            self._refit()
        self._add_pending()
        linear, smooth = p.columns, p.columns + r.SMOOTH
        sizes = (linear, smooth, self._size) if p.features else (linear,)
        ridge = np.full(self._size, _ROW_RIDGE)
        ridge[: 1 + p.depth] = _RIDGE
        ridge[: linear : 1 + p.depth] = _CONSTANT_RIDGE
        ridge[linear:] = _FEATURE_RIDGE
        for owned, weights, factor in self._sums.solutions(ridge, sizes):
            for kind, each in enumerate(weights):
                self._publish(kind, owned, each)
            if 0 in owned:
                p.known = known = sizes[:2][-1]
                inverse, _ = lapack.dtrtri(factor[:known, :known], lower=1)
                p.inverse[:known, :known] = inverse

    def _publish(self, kind: int, owned: NDArray[np.int64], weights: Vector) -> None:
        """Publish a solution: weights of each row are the sum of those that it shares."""
        p = self._parameters
        blocks = weights[: p.columns].reshape(1 + p.rows, 1 + p.depth, len(owned))
        heads = p.head_of_rows
        by_row = blocks[0] + blocks[1 + heads]
        by_row[p.heads :] += blocks[1 + p.heads :]
        p.linear[:, kind, owned] = by_row.transpose(0, 2, 1)
        features = weights[p.columns :].T
        if kind:
            p.amplitude[kind - 1, owned, : features.shape[1]] = features

    def _unexplained(self) -> bool:
        """Return whether linear models leave a large error, and there are enough samples."""
        left = self._loss[r.LINEAR] > _UNEXPLAINED * self._spread + 1e-18
        return self._kept.seen - self._start >= _FEATURES_FROM and bool(left.any())

    _COUNTS: Final = ("start", "pending", "since_solved", "alarms", "of_episode")
    _SUMS: Final = ("block_of", "gram", "moment")
    _RANGES: Final = {
        "seen": (0, MOST), "surprises": (0.0, 1.0), "firsts": (0, MOST),
        "loss": (0.0, np.inf), "spread": (0.0, np.inf), "samples": (0, MOST),
        "own": (0.0, np.inf),
    }  # fmt: skip

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {name: getattr(self, f"_{name}").copy() for name in self._RANGES}
        arrays |= {name: getattr(self._sums, name).copy() for name in self._SUMS}
        arrays |= {"low": self._ranges.low.copy(), "high": self._ranges.high.copy()}
        arrays |= nested("before", self._before.contents())
        arrays |= {f"shelved{k}": array.copy() for k, array in enumerate(self._shelved)}
        meta = {name: getattr(self, f"_{name}") for name in self._COUNTS}
        meta |= {"samples": self._kept.seen, "total": self._sums.total}
        meta["outliers"] = self._ranges.outliers
        return arrays | nested("kept", self._kept.state_dict()), meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the buffer; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        seen = saved.whole("samples")
        self._kept.load_state_dict(Saved("residual", part_of(arrays, "kept"), {}), seen)
        for name in self._COUNTS:
            setattr(self, f"_{name}", saved.whole(name))
        self._before.restore(part_of(arrays, "before"))
        for k, array in enumerate(self._shelved):
            array[:] = saved.array(f"shelved{k}", np.float64, array.shape, 0.0)
        if self._start > seen:
            raise saved.wrong("the last change is later than the last sample")
        if self._pending > min(len(self._kept), _PENDING):
            raise saved.wrong("more samples are pending than there are")
        for name, (low, high) in self._RANGES.items():
            own = getattr(self, f"_{name}")
            own[:] = saved.array(name, own.dtype, own.shape, low, high)
        self._ranges.outliers = saved.whole("outliers")
        for name, own in (("low", self._ranges.low), ("high", self._ranges.high)):
            own[:] = saved.array(name, np.float64, own.shape, -np.inf, np.inf)
        block_of = self._sums.block_of
        block_of[:] = saved.array("block_of", np.int64, block_of.shape, 0, 1)
        self._sums.clear(self._size)
        for name, own in (("gram", self._sums.gram), ("moment", self._sums.moment)):
            own[:] = saved.array(name, np.float64, own.shape)
        self._sums.total = saved.real("total", 0.0)
