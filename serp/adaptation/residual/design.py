"""Rows of the design matrix of a regression, and what its weights predict from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.features import features_of
from serp.model.native import advanced, pointer_to
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator"


@cached_njit(nogil=True)
def _fill(x, rows, heads, weight, published, features, out):
    """Fill rows of the design matrix, each times its weight; `out` `[n, D]` begins with zeros.

    `x` `[n, d]` are inputs, changed to normalised ones, `rows` `[n]` their rows, `heads` `[R]` the
    head of each row; `published` are centre, shrink, frequency and phase.
    """
    centre, shrink, frequency, phase = published
    depth = x.shape[1]
    block, columns = 1 + depth, (1 + heads.shape[0]) * (1 + depth)
    for k in range(x.shape[0]):
        u, row, w = x[k], rows[k], weight[k]
        for i in range(depth):
            u[i] = (u[i] - centre[i]) * shrink[i]
        for which in range(3 if heads[row] != row else 2):
            start = 0
            if which > 0:
                start = (1 + (heads[row] if which == 1 else row)) * block
            out[k, start] = w
            for i in range(depth):
                out[k, start + 1 + i] = w * u[i]
        for first in range(0, features, r.SMOOTH):
            z = advanced(pointer_to(out[k], 0), columns + first)
            features_of(
                pointer_to(frequency, 0), pointer_to(phase, 0), pointer_to(u, 0), depth, first, z
            )
            for i in range(r.SMOOTH):
                z[i] *= w


def design_matrix(
    p: r.RegressionParameters, x: Vector, rows: NDArray[np.int64], weight: Vector
) -> Vector:
    """Return rows of the design matrix, each times its weight; `x` `[n, d]` is normalised."""
    out = np.zeros((len(x), p.columns + p.features))
    published = p.centre, p.shrink, p.frequency, p.phase
    _fill(x, rows, p.head_of_rows, weight, published, p.features, out)
    return out


def predicted(p: r.RegressionParameters, x: Vector, rows: NDArray[np.int64]) -> Vector:
    """Return what the predictors in use say of inputs, `[n, T]`; `x` is normalised."""
    out = np.zeros((len(x), p.count))
    design = design_matrix(p, x, rows, np.ones(len(x)))
    for t, kind in enumerate(p.kinds.astype(int)):
        if kind != r.FILE:
            out[:, t] = (p.linear[rows, kind - 1, t] * design[:, : 1 + p.depth]).sum(axis=1)
        if kind > r.LINEAR and p.features:
            out[:, t] += design[:, p.columns :] @ p.amplitude[kind - r.CURVED, t]
    return out
