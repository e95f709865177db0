"""The residual: what was learned of the one-step error of the file's effects and processes.

The order of all operations is that of serp's compiled loops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .folder import ControllerError

FILE, LINEAR, CURVED, FULL = range(4)
"""The predictor of a fluent: the file alone, or with a linear model, with the smoothest features,
or with all of them."""
CODES, CHUNK, RANGE, UNKNOWN = 64, 64, 1.3, 0.5
"""Values of a group's predicates; features that are summed at a time; largest normalised input
within the range of the data; leverage from which on the data say less than the prior."""

_BLOCK = 256
"""States whose features are computed together: they stay in the processor's cache."""

Array = NDArray[Any]


class FeatureColumns(NamedTuple):
    """A feature group of an action: its columns in the state, and its regression."""

    inputs: list[int]
    targets: list[int]
    regression: FittedRegression
    head: int


class FittedRegression:
    """One regression, shared by actions whose groups have the same roles.

    Args:
        data: Its shape, and the positions of the predicates that tell modes apart.
        arrays: Its arrays; see `serp.adaptation.residual.parameters.RegressionParameters`.
    """

    def __init__(self, data: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
        self.bits: list[int] = data["bits"]
        self.depth, self.count = int(data["depth"]), int(data["count"])
        self.heads, self._known = int(data["heads"]), int(data["known"])
        self.kinds = [int(kind) for kind in arrays["kinds"].tolist()]
        self.most = max(self.kinds, default=FILE)
        self._rows = {code: self.heads + k for k, code in enumerate(arrays["codes"].tolist())}
        self._centre, self._shrink = arrays["centre"].tolist(), arrays["shrink"].tolist()
        self._linear: list[list[list[list[float]]]] = arrays["linear"].tolist()
        self._frequency, self._phase = arrays["frequency"], arrays["phase"]
        self._amplitude = arrays["amplitude"]
        self._inverse = np.tril(arrays["inverse"])
        self._columns = (1 + len(self._linear)) * (1 + self.depth)

    def row_of(self, head: int, inputs: list[int], state: list[float]) -> int:
        """Return the row of a head in a state: that of its mode, or its own."""
        if not self.bits:
            return head
        code, weight = float(CODES * head), 1.0
        for place in self.bits:
            if state[inputs[place]] != 0.0:
                code += weight
            weight *= 2.0
        return self._rows.get(code, head)

    def add(self, group: FeatureColumns, state: list[float], out: list[float]) -> None:
        """Add the residual of a group to `out`."""
        inputs, targets = group.inputs, group.targets
        row = self.row_of(group.head, inputs, state)
        u = [
            (state[column] - centre) * shrink
            for column, centre, shrink in zip(inputs, self._centre, self._shrink, strict=True)
        ]
        most = self.most
        if most > LINEAR and not all(abs(x) <= RANGE for x in u):
            unknown = self._leverage(row, group.head, np.array([u]))[0] >= UNKNOWN
            most = LINEAR if unknown else most
        linear = self._linear[row]
        for t, kind in enumerate(self.kinds):
            if kind != FILE:
                total, *weights = linear[(kind if kind < most else most) - 1][t]
                for weight, x in zip(weights, u):  # noqa: B905  (strict costs a tenth of a step)
                    total += weight * x
                out[targets[t]] += total
        if most <= LINEAR:
            return
        count = CHUNK if most == CURVED else len(self._phase)
        z = self._features(np.array(u), slice(count))
        for t, kind in enumerate(self.kinds):
            if kind >= CURVED:
                used = z[:CHUNK] if kind == CURVED else z
                products = self._amplitude[kind - CURVED, t, : len(used)] * used
                for part in _pairwise(products.reshape(-1, CHUNK)).tolist():
                    out[targets[t]] += part

    def add_rows(self, group: FeatureColumns, states: Array, out: Array) -> None:
        """Add the residual of a group to the columns of `out`, see `add`."""
        inputs = group.inputs
        u = [
            (states[column] - centre) * shrink
            for column, centre, shrink in zip(inputs, self._centre, self._shrink, strict=True)
        ]
        rows = self._rows_of(group.head, inputs, states)
        far = np.zeros(states.shape[1], np.bool_)
        if self.most > LINEAR:
            for x in u:
                far |= ~(np.abs(x) <= RANGE)
        for row in np.unique(rows).tolist():
            some = np.flatnonzero(far & (rows == row))
            if len(some):
                by = np.array([x[some] for x in u]).T
                far[some] = self._leverage(row, group.head, by) >= UNKNOWN
            for beyond in (False, True):
                some = np.flatnonzero((rows == row) & (far == beyond))
                if len(some):
                    most = min(LINEAR, self.most) if beyond else self.most
                    self._add_linear(group, [x[some] for x in u], row, most, some, out)
        near = np.flatnonzero(~far)
        if self.most > LINEAR and len(near):
            self._add_features(group, [x[near] for x in u], near, out)

    def _rows_of(self, head: int, inputs: list[int], states: Array) -> Array:
        rows = np.full(states.shape[1], head)
        if self.bits:
            codes, weight = np.full(states.shape[1], float(CODES * head)), 1.0
            for place in self.bits:
                codes += np.where(states[inputs[place]] != 0.0, weight, 0.0)
                weight *= 2.0
            for code, row in self._rows.items():
                rows[codes == code] = row
        return rows

    def _add_linear(
        self, group: FeatureColumns, u: list[Array], row: int, most: int, some: Array, out: Array
    ) -> None:
        for t, kind in enumerate(self.kinds):
            kind = min(kind, most)
            if kind != FILE:
                constant, *weights = self._linear[row][kind - 1][t]
                total = np.full(len(some), constant)
                for weight, x in zip(weights, u, strict=True):
                    total += weight * x
                out[group.targets[t], some] += total

    def _add_features(self, group: FeatureColumns, u: list[Array], some: Array, out: Array) -> None:
        by = np.array(u).T
        last = CHUNK if self.most == CURVED else len(self._phase)
        for start in range(0, len(some), _BLOCK):
            block = slice(start, start + _BLOCK)
            for first in range(0, last, CHUNK):
                z = self._features(by[block], slice(first, first + CHUNK))
                for t, kind in enumerate(self.kinds):
                    if kind == FULL or (kind == CURVED and first == 0):
                        weights = self._amplitude[kind - CURVED, t, first : first + CHUNK]
                        out[group.targets[t], some[block]] += _pairwise(weights * z)

    def _features(self, u: Array, part: slice) -> Array:
        """Return a part of the random features of normalised inputs `[d]` or `[N, d]`."""
        z = np.broadcast_to(
            self._phase[part], (*u.shape[:-1], part.stop - (part.start or 0))
        ).copy()
        for i in range(self.depth):
            z += self._frequency[i, part] * u[..., i, None]
        turns = z * 0.15915494309189535 + 0.25
        turns -= np.floor(turns + 0.5)
        y = 8.0 * turns - 16.0 * turns * np.abs(turns)
        found: Array = 0.225 * (y * np.abs(y) - y) + y
        return found

    def _leverage(self, row: int, head: int, u: Array) -> Array:
        """Return how far inputs `[N, d]` are from the data, from 0 to 1."""
        if self._known == 0:
            return np.ones(len(u))
        block = np.column_stack((np.ones(len(u)), u))
        size, columns = block.shape[1], self._columns
        design = np.zeros((len(u), len(self._inverse)))
        design[:, :size] = block
        design[:, (1 + head) * size : (2 + head) * size] = block
        if row >= self.heads:
            design[:, (1 + row) * size : (2 + row) * size] = block
        if self._known > columns:
            design[:, columns:] = self._features(u, slice(CHUNK))
        # The order of this sum is another; it matters only within 1e-12 of the threshold.
        q = ((design @ self._inverse[: self._known].T) ** 2).sum(axis=1)
        found: Array = q / (1.0 + q)
        return found


def _pairwise(products: Array) -> Array:
    """Return the sum of each row of `CHUNK` numbers."""
    width = CHUNK
    while width > 1:
        width //= 2
        products = products[:, :width] + products[:, width : 2 * width]
    sums: Array = products[:, 0]
    return sums


class Residual:
    """The residual of every action.

    Attributes:
        used: `[A]` whether it predicts anything of an action.
    """

    def __init__(self, data: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
        regressions = [
            FittedRegression(each, parts_of(arrays, f"regression{k}."))
            for k, each in enumerate(data["regressions"])
        ]
        self._groups = [
            [
                FeatureColumns(
                    g["inputs"], g["targets"], regressions[g["regression"]], int(g["head"])
                )
                for g in groups
                if g["regression"] is not None and regressions[g["regression"]].most != FILE
            ]
            for groups in data["actions"]
        ]
        for group in (group for groups in self._groups for group in groups):
            made = group.regression
            if (len(group.inputs), len(group.targets)) != (made.depth, made.count):
                raise ControllerError("the adaptation of the policy is damaged: a group's size")
        self.used = [bool(groups) for groups in self._groups]

    def add(self, state: list[float], action: int, out: list[float]) -> None:
        """Add the residual of an action to `out`."""
        for group in self._groups[action]:
            group.regression.add(group, state, out)

    def add_rows(self, states: Array, action: int, out: Array) -> None:
        """Add the residual of an action to `out` `[F + 1, N]`, of states `[F, N]`."""
        for group in self._groups[action]:
            group.regression.add_rows(group, states, out)


def parts_of(arrays: Mapping[str, Array], name: str) -> dict[str, Array]:
    """Return the arrays whose names begin with another, without it; all numbers are finite."""
    found = {key[len(name) :]: array for key, array in arrays.items() if key.startswith(name)}
    for key, array in found.items():
        if not all(map(math.isfinite, (float(array.min(initial=0)), float(array.max(initial=0))))):
            raise ControllerError(f"the array {name}{key} holds a number that is not finite")
    return found
