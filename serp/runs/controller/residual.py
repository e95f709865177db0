"""The residual: what was learned of the one-step error of the file's effects and processes.

The order of all operations is that of serp's compiled loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .reading import Arrays, Entry

FILE, LINEAR, CURVED, FULL = range(4)
"""The predictor of a fluent: the file alone, or with a linear model, with the smoothest features,
or with all of them."""
CODES, CHUNK, RANGE, UNKNOWN = 64, 64, 1.3, 0.5
"""Values of a group's predicates; features that are summed at a time; largest normalised input
within the range of the data; leverage from which on the data say less than the prior."""

Array = NDArray[Any]


class FittedRegression:
    """One regression, shared by actions whose groups have the same roles.

    Args:
        data: Its shape, and the positions of the predicates that tell modes apart.
        arrays: Its arrays; see `serp.adaptation.residual.parameters.RegressionParameters`.

    Attributes:
        depth, count, heads: Numbers of inputs, targets and actions.
        kinds: `[T]` predictor of each target.
        most: The largest of them.
        bits: Positions of the predicates that tell modes apart.
        row_of_code: The row of linear weights of each mode.
        linear: `[R, 3, T, 1 + d]` weights of a constant and the inputs, by row and predictor.
        waving: Targets with features; `amplitude` `[W, C, CHUNK]` are their weights.
    """

    def __init__(self, data: Entry, arrays: Arrays) -> None:
        self.depth, self.count = data["depth"].whole(0), data["count"].whole(0)
        self.heads = data["heads"].whole(1)
        self.bits = data["bits"].positions(self.depth)
        if 2 ** len(self.bits) > CODES:
            raise data["bits"].wrong(f"their values must be at most {CODES}")
        self.kinds: list[int] = arrays.whole("kinds", FILE, FULL, self.count).tolist()
        self.most = max(self.kinds, default=FILE)
        self.linear = arrays.numbers("linear", None, 3, self.count, 1 + self.depth)
        codes = arrays.whole("codes", 0, CODES * self.heads - 1, None).tolist()
        if len(set(codes)) < len(codes) or self.heads + len(codes) > len(self.linear):
            raise arrays.wrong("codes", "holds some twice, or more than there are weights for")
        self.row_of_code = np.repeat(np.arange(self.heads), CODES)
        self.row_of_code[codes] = self.heads + np.arange(len(codes))
        self.centre = arrays.numbers("centre", self.depth)
        self.shrink = arrays.numbers("shrink", self.depth)
        phase = arrays.numbers("phase", None)
        if len(phase) % CHUNK or not len(phase):
            raise arrays.wrong("phase", f"has {len(phase)} numbers, not a multiple of {CHUNK}")
        frequency = arrays.numbers("frequency", self.depth, len(phase))
        amplitude = arrays.numbers("amplitude", 2, self.count, len(phase))
        self._columns = (1 + len(self.linear)) * (1 + self.depth)
        size = self._columns + CHUNK
        self._known = data["known"].whole(0, size)
        self._inverse = np.tril(arrays.numbers("inverse", size, size))[: self._known]
        self.chunks = len(phase) // CHUNK if self.most == FULL else 1
        self.waves = np.vstack((phase, frequency))[:, : CHUNK * self.chunks].copy()
        """`[1 + d, C * CHUNK]` phase and frequencies of the features in use."""
        self.waving = [t for t, kind in enumerate(self.kinds) if kind >= CURVED]
        self.amplitude = np.array(
            [amplitude[self.kinds[t] - CURVED, t, : CHUNK * self.chunks] for t in self.waving]
        ).reshape(len(self.waving), self.chunks, CHUNK)
        self._normal = list(zip(self.centre.tolist(), self.shrink.tolist(), strict=True))
        self._weights = [
            [self._of_row(row, most) for most in range(1 + self.most)] for row in self.linear
        ]
        self._rows: list[int] = self.row_of_code.tolist()

    def _of_row(self, weights: Array, most: int) -> list[tuple[int, float, list[float]]]:
        """Return target, constant and weights of each linear model, with predictors up to one."""
        found = []
        for t, kind in enumerate(min(kind, most) for kind in self.kinds):
            if kind != FILE:
                constant, *others = weights[kind - 1, t].tolist()
                found.append((t, constant, others))
        return found

    def linear_of(self, row: int, most: int) -> list[tuple[int, float, list[float]]]:
        """Return target, constant and weights of each linear model in a row."""
        return self._weights[row][most]

    def parts_of(self, t: int) -> int:
        """Return how many sums of `CHUNK` features a target has."""
        return self.chunks if self.kinds[t] == FULL else 1

    def add(
        self, inputs: Sequence[int], targets: Sequence[int], head: int,
        state: list[float], out: list[float],
    ) -> None:  # fmt: skip
        """Add the residual of a group of fluents to `out`."""
        u = [
            (state[column] - centre) * shrink
            for column, (centre, shrink) in zip(inputs, self._normal)  # noqa: B905  (time)
        ]
        code, weight = CODES * head, 1
        for place in self.bits:
            if state[inputs[place]] != 0.0:
                code += weight
            weight *= 2
        row, most = self._rows[code], self.most
        if most > LINEAR:
            for x in u:
                if not -RANGE <= x <= RANGE:
                    one = np.array([row]), np.array([head]), np.array(u)[:, None]
                    if self.leverage(*one)[0] >= UNKNOWN:
                        most = LINEAR
                    break
        for t, total, weights in self._weights[row][most]:
            for factor, x in zip(weights, u):  # noqa: B905  (strict costs a tenth of a step)
                total += factor * x
            out[targets[t]] += total
        if most > LINEAR:
            z = np.add.reduce(self.waves * np.array([1.0, *u])[:, None], axis=0)
            sums = _summed(self.amplitude * _sine(z).reshape(-1, CHUNK)).tolist()
            for t, parts in zip(self.waving, sums, strict=True):
                for part in parts[: self.parts_of(t)]:
                    out[targets[t]] += part

    def sums_of(self, u: Array) -> Array:
        """Return the weighted features `[W, C, N]` of normalised inputs `[d, N]`."""
        z = self._features(u, len(self.waves[0])).reshape(self.chunks, CHUNK, -1)
        return _summed((self.amplitude[..., None] * z).swapaxes(2, 3))

    def _features(self, u: Array, count: int) -> Array:
        """Return the first random features `[count, N]` of normalised inputs `[d, N]`."""
        phase, *frequencies = self.waves[:, :count, None]
        z = np.repeat(phase, u.shape[1], axis=1)
        for frequency, x in zip(frequencies, u, strict=True):
            z += frequency * x
        return _sine(z)

    def leverage(self, rows: Array, heads: Array, u: Array) -> Array:
        """Return how far inputs `[d, N]` are from the data, from 0 to 1."""
        count = u.shape[1]
        if self._known == 0:
            return np.ones(count)
        block, each = np.vstack((np.ones(count), u)), np.arange(count)
        size = len(block)
        blocks = np.zeros((1 + len(self.linear), size, count))
        blocks[0] = block
        blocks[1 + heads, :, each] = block.T
        own = rows >= self.heads
        blocks[1 + rows[own], :, each[own]] = block.T[own]
        design: Array = blocks.reshape(-1, count)
        if self._known > self._columns:
            design = np.vstack((design, self._features(u, CHUNK)))
        # The order of this sum is another; it matters only within 1e-12 of the threshold.
        q = ((self._inverse[:, : len(design)] @ design) ** 2).sum(axis=0)
        found: Array = q / (1.0 + q)
        return found


def _sine(z: Array) -> Array:
    """Return the sine of angles, shifted, by parabolas; the angles are overwritten."""
    z *= 0.15915494309189535
    z += 0.25
    z -= np.floor(z + 0.5)
    y = 16.0 * z
    y *= np.abs(z)
    z *= 8.0
    z -= y
    y = np.abs(z)
    y *= z
    y -= z
    y *= 0.225
    y += z
    return y


def _summed(products: Array) -> Array:
    """Return the sums over the last axis, of `CHUNK` numbers, halves added to halves."""
    width = CHUNK
    while width > 1:
        width //= 2
        products = products[..., :width] + products[..., width:]
    return products[..., 0]
