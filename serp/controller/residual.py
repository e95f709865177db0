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
        inputs, targets, depth = group.inputs, group.targets, self.depth
        row = self.row_of(group.head, inputs, state)
        u = [
            (state[column] - centre) * shrink
            for column, centre, shrink in zip(inputs, self._centre, self._shrink, strict=True)
        ]
        most = self.most
        if most > LINEAR and not all(abs(x) <= RANGE for x in u):
            most = LINEAR if self._leverage(row, group.head, u) >= UNKNOWN else most
        linear = self._linear[row]
        for t, kind in enumerate(self.kinds):
            kind = min(kind, most)
            if kind != FILE:
                weights = linear[kind - 1][t]
                total = weights[0]
                for i in range(depth):
                    total += weights[1 + i] * u[i]
                out[targets[t]] += total
        if most <= LINEAR:
            return
        z = self._features(u, CHUNK if most == CURVED else len(self._phase))
        for t, kind in enumerate(self.kinds):
            if kind >= CURVED:
                used = z[:CHUNK] if kind == CURVED else z
                products = self._amplitude[kind - CURVED, t, : len(used)] * used
                for part in _pairwise(products.reshape(-1, CHUNK)):
                    out[targets[t]] += part

    def _features(self, u: list[float], count: int) -> Array:
        """Return the first random features of normalised inputs."""
        z = self._phase[:count].copy()
        for i, x in enumerate(u):
            z += self._frequency[i, :count] * x
        turns = z * 0.15915494309189535 + 0.25
        turns -= np.floor(turns + 0.5)
        y = 8.0 * turns - 16.0 * turns * np.abs(turns)
        found: Array = 0.225 * (y * np.abs(y) - y) + y
        return found

    def _leverage(self, row: int, head: int, u: list[float]) -> float:
        """Return how far an input is from the data, from 0 to 1."""
        if self._known == 0:
            return 1.0
        block = [1.0, *u]
        size, columns = len(block), self._columns
        design = np.zeros(len(self._inverse))
        design[:size] = block
        design[(1 + head) * size : (2 + head) * size] = block
        if row >= self.heads:
            design[(1 + row) * size : (2 + row) * size] = block
        if self._known > columns:
            design[columns:] = self._features(u, CHUNK)
        # The order of this sum is another; it matters only within 1e-12 of the threshold.
        q = float(((self._inverse[: self._known] @ design) ** 2).sum())
        return q / (1.0 + q)


def _pairwise(products: Array) -> list[float]:
    """Return the sum of each row of `CHUNK` numbers."""
    width = CHUNK
    while width > 1:
        width //= 2
        products = products[:, :width] + products[:, width : 2 * width]
    sums: list[float] = products[:, 0].tolist()
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


def parts_of(arrays: Mapping[str, Array], name: str) -> dict[str, Array]:
    """Return the arrays whose names begin with another, without it; all numbers are finite."""
    found = {key[len(name) :]: array for key, array in arrays.items() if key.startswith(name)}
    for key, array in found.items():
        if not all(map(math.isfinite, (float(array.min(initial=0)), float(array.max(initial=0))))):
            raise ControllerError(f"the array {name}{key} holds a number that is not finite")
    return found
