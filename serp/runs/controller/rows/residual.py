"""The residual for many states at once; see `controller.residual`, and `rows.step` for arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..residual import CODES, FILE, LINEAR, RANGE, UNKNOWN, FittedRegression

if TYPE_CHECKING:
    from ..adaptation import LearnedGroup

Array = NDArray[Any]
_BLOCK = 128
"""States whose features are computed together: they stay in the processor's cache."""


class ResidualRows:
    """The residual of every action.

    Args:
        groups: `[A]` feature groups of each action, which are added in this order.
    """

    def __init__(self, groups: Sequence[Sequence[LearnedGroup]]) -> None:
        self._rounds: list[tuple[RegressionRows, list[tuple[int, LearnedGroup]]]] = []
        for place in range(max(map(len, groups), default=0)):
            shared: dict[int, tuple[RegressionRows, list[tuple[int, LearnedGroup]]]] = {}
            for action, of_action in enumerate(groups):
                made = of_action[place].regression if place < len(of_action) else None
                if made is not None:
                    known = shared.setdefault(id(made), (RegressionRows(made), []))
                    known[1].append((action, of_action[place]))
            self._rounds += shared.values()

    def add(self, states: Array, bounds: Sequence[int], out: Array) -> None:
        """Add it to `out`; where a result is not finite, that of the file is kept."""
        if not self._rounds:
            return
        before = out.copy()
        for regression, groups in self._rounds:
            parts = [
                (group, slice(bounds[action], bounds[action + 1]))
                for action, group in groups
                if bounds[action] < bounds[action + 1]
            ]
            if not parts:
                continue
            x = np.concatenate([states[group.inputs, part] for group, part in parts], axis=1)
            y = np.concatenate([out[group.targets, part] for group, part in parts], axis=1)
            sizes = [part.stop - part.start for _, part in parts]
            heads = np.repeat([group.head for group, _ in parts], sizes)
            regression.add(x, heads, y)
            last = 0
            for (group, part), size in zip(parts, sizes, strict=True):
                out[group.targets, part] = y[:, last : last + size]
                last += size
        wrong = ~np.isfinite(out[:-1]).all(axis=0)
        if wrong.any():
            out[:, wrong] = before[:, wrong]


class RegressionRows:
    """One regression for many states."""

    def __init__(self, made: FittedRegression) -> None:
        self._made = made
        self._used = np.array([t for t, kind in enumerate(made.kinds) if kind != FILE], np.int64)
        self._kinds = np.array(made.kinds, np.int64)[self._used, None]
        self._weights = np.moveaxis(made.linear, 3, 0).reshape(1 + made.depth, -1).copy()

    def add(self, x: Array, heads: Array, y: Array) -> None:
        """Add the residual to targets `y` `[T, N]`; inputs are `x` `[d, N]`, heads `[N]`."""
        made = self._made
        u = (x - made.centre[:, None]) * made.shrink[:, None]
        codes, weight = CODES * heads, 1
        for place in made.bits:
            codes = codes + weight * (x[place] != 0.0)
            weight *= 2
        rows = made.row_of_code[codes]
        kinds, near = self._kinds, np.arange(x.shape[1])
        if made.most > LINEAR:
            far = ~(np.abs(u) <= RANGE).all(axis=0)
            some = np.flatnonzero(far)
            if len(some):
                far[some] = made.leverage(rows[some], heads[some], u[:, some]) >= UNKNOWN
                kinds = np.where(far, np.minimum(kinds, LINEAR), kinds)
                near = np.flatnonzero(~far)
        places = (rows * 3 + kinds - 1) * made.count + self._used[:, None]
        total = self._weights[0].take(places)
        for weights, each in zip(self._weights[1:], u, strict=True):
            total += weights.take(places) * each
        y[self._used] += total
        if made.most > LINEAR:
            for first in range(0, len(near), _BLOCK):
                block = near[first : first + _BLOCK]
                for t, sums in zip(made.waving, made.sums_of(u[:, block]), strict=True):
                    for part in sums[: made.parts_of(t)]:
                        y[t, block] += part
