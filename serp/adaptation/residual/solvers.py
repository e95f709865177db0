"""Compiled solvers of the online regressions, from their statistics.

Shapes: d inputs, T targets, n actions. Inputs are normalised by the centres and half widths of
their ranges; `shrink` is 1 over the half widths.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_CONSTANT = 0.01
"""Ridge of the constants relative to that of the slopes; actions differ mainly in constants."""


@cached_njit(nogil=True)
def solve_pooled(grams, moments, centres, shrink, ridge, own, out):
    """Solve the regression of n actions that differ only in their constants, for the action `own`.

    `grams` `[n, T, 1 + d, 1 + d]` and `moments` `[n, T, 1 + d]` are statistics, each about its own
    origin; `centres` `[n, d]` of the ranges are relative to it. `ridge` is that of the slopes.
    `out` `[T, 1 + d]` receives the weights about the origin, where there is a solution.
    """
    actions, targets, size = moments.shape
    depth = size - 1
    for t in range(targets):
        matrix = np.zeros((actions + depth, actions + depth))
        right = np.zeros(actions + depth)
        for a in range(actions):
            gram, moment, centre = grams[a, t], moments[a, t], centres[a]
            matrix[a, a] = gram[0, 0] + _CONSTANT * ridge
            right[a] = moment[0]
            for i in range(depth):
                # Sums of normalised inputs, from those of the inputs.
                first = (gram[0, 1 + i] - centre[i] * gram[0, 0]) * shrink[i]
                matrix[a, actions + i] = first
                matrix[actions + i, a] = first
                right[actions + i] += (moment[1 + i] - centre[i] * moment[0]) * shrink[i]
                for j in range(depth):
                    matrix[actions + i, actions + j] += (
                        gram[1 + i, 1 + j]
                        - centre[i] * gram[0, 1 + j]
                        - centre[j] * gram[0, 1 + i]
                        + centre[i] * centre[j] * gram[0, 0]
                    ) * (shrink[i] * shrink[j])
        for i in range(depth):
            matrix[actions + i, actions + i] += ridge
        solution = np.linalg.solve(matrix, right)
        if np.isfinite(solution).all():
            out[t, 0] = solution[own]
            for i in range(depth):
                out[t, 1 + i] = solution[actions + i] * shrink[i]
                out[t, 0] -= out[t, 1 + i] * centres[own, i]


@cached_njit(nogil=True)
def solve_ridge(grams, moments, counts, origin, centre, shrink, ridge, priors, out):
    """Solve the ridge regression of every target that has samples, where there is a solution.

    `grams` `[T, 1 + d, 1 + d]` and `moments` `[T, 1 + d]` are statistics of the inputs less their
    `origin`, as the `priors` `[T, 1 + d]` towards which the ridge pulls; `out` are weights of the
    inputs themselves.
    """
    size = moments.shape[1]
    # Rows of `change`: normalised inputs in terms of (1, x).
    change = np.zeros((size, size))
    change[0, 0] = 1.0
    for i in range(1, size):
        change[i, 0] = (origin[i - 1] - centre[i - 1]) * shrink[i - 1]
        change[i, i] = shrink[i - 1]
    for t in range(counts.shape[0]):
        if not counts[t] > 0:
            continue
        gram, prior = grams[t], priors[t]
        matrix = change @ gram @ change.T
        for i in range(size):
            matrix[i, i] += ridge
        right = change @ (moments[t] - gram @ prior)
        solution = prior + change.T @ np.linalg.solve(matrix, right)
        if np.isfinite(solution).all():
            for i in range(1, size):
                solution[0] -= solution[i] * origin[i - 1]
            out[t] = solution


@cached_njit(nogil=True)
def accumulate_fourier(x, y, features, gram, moment):
    """Add one sample to the statistics of (1, x, features), `[D, D]` and `[D, T]`.

    `x` `[d]` are the inputs less their origin; of `gram` the lower triangle is used.
    """
    depth, count = x.shape[0], features.shape[0]
    size = 1 + depth + count
    row = np.empty(size)
    row[0] = 1.0
    for i in range(depth):
        row[1 + i] = x[i]
    for k in range(count):
        row[1 + depth + k] = features[k]
    for i in range(size):
        a = row[i]
        for j in range(i + 1):
            gram[i, j] += a * row[j]
        for t in range(y.shape[0]):
            moment[i, t] += a * y[t]
