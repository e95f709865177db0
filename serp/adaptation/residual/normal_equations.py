"""The normal equations of a linear regression of several targets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from serp.model.transition_model import Vector

_HALVED: Final = 8192.0  # samples at which those added before lose half of their weight


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
        if self.total > _HALVED:
            self.total *= 0.5
            self.gram *= 0.5
            self.moment *= 0.5

    def solutions(
        self, ridge: Vector, sizes: Sequence[int]
    ) -> Iterator[tuple[NDArray[np.int64], list[Vector], Vector]]:
        """Yield targets, their weights by the first columns of each size, and the Cholesky factor.

        Nothing is yielded for a matrix without a finite solution.
        """
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
