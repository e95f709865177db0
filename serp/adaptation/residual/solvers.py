"""The compiled solutions of the online regression, from its statistics.

Shapes: d inputs, T targets, n actions.
"""

from __future__ import annotations

import math

import numpy as np

from serp._util.compilation import cached_njit

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_FREE = 0.01
"""Constants are drawn to 0 so much less than slopes: what an action does is found first there."""


@cached_njit(nogil=True)
def solve_pooled(grams, moments, centres, shrink, ridge, out):
    """Solve the regression of several actions that differ in their constants alone.

    Args:
        grams: `[n, 1 + d, 1 + d]` statistics of n actions, each about an origin of its own.
        moments: `[n, 1 + d]` the same.
        centres: `[n, d]` of the ranges over all of them, seen from each origin.
        shrink: `[d]` 1 over half the ranges.
        ridge: Of the weights of the inputs, normalised by their ranges, towards 0.
        out: `[n, 1 + d]` receives the weights of each, about its origin.

    Returns:
        Whether there is a solution.
    """
    actions, size = moments.shape
    depth = size - 1
    matrix = np.zeros((actions + depth, actions + depth))
    right = np.zeros(actions + depth)
    for a in range(actions):
        gram, centre = grams[a], centres[a]
        matrix[a, a] = gram[0, 0] + _FREE * ridge
        right[a] = moments[a, 0]
        for i in range(depth):
            # Sums of normalised inputs, from those of the inputs as they are.
            first = (gram[0, 1 + i] - centre[i] * gram[0, 0]) * shrink[i]
            matrix[a, actions + i] = first
            matrix[actions + i, a] = first
            right[actions + i] += (moments[a, 1 + i] - centre[i] * moments[a, 0]) * shrink[i]
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
    for k in range(actions + depth):
        if not math.isfinite(solution[k]):
            return False
    for a in range(actions):
        out[a, 0] = solution[a]
        for i in range(depth):
            out[a, 1 + i] = solution[actions + i] * shrink[i]
            out[a, 0] -= out[a, 1 + i] * centres[a, i]
    return True


@cached_njit(nogil=True)
def solve_linear(gram, moment, origin, centre, shrink, ridge, prior, out):
    """Solve one ridge regression `[1 + d]` on inputs normalised by their ranges.

    Statistics and the `prior` that weights are drawn to are those of the inputs less their
    `origin`, the solution is that of the inputs as they are.
    """
    size = moment.shape[0]
    # Rows of `change`: normalised features in terms of (1, x).
    change = np.zeros((size, size))
    change[0, 0] = 1.0
    for i in range(1, size):
        change[i, 0] = (origin[i - 1] - centre[i - 1]) * shrink[i - 1]
        change[i, i] = shrink[i - 1]
    matrix = change @ gram @ change.T
    for i in range(size):
        matrix[i, i] += ridge
    solution = prior + change.T @ np.linalg.solve(matrix, change @ (moment - gram @ prior))
    for i in range(size):
        if not math.isfinite(solution[i]):
            return False
    for i in range(1, size):
        solution[0] -= solution[i] * origin[i - 1]
    out[:] = solution
    return True


@cached_njit(nogil=True)
def solve_pooled_targets(grams, moments, centres, shrink, ridge, own, out):
    """Solve the pooled regression of every target.

    Args:
        grams: `[n, T, 1 + d, 1 + d]`, see `solve_pooled`.
        moments: `[n, T, 1 + d]`, likewise.
        centres: See there.
        shrink: See there.
        ridge: See there.
        own: Which of the actions is wanted.
        out: `[T, 1 + d]` receives its weights, where there is a solution.
    """
    pooled = np.empty((grams.shape[0], moments.shape[2]))
    for t in range(out.shape[0]):
        if solve_pooled(grams[:, t], moments[:, t], centres, shrink, ridge, pooled):
            out[t] = pooled[own]


@cached_njit(nogil=True)
def solve_linear_targets(gram, moment, count, origin, centre, shrink, ridge, prior, out):
    """Solve the ridge regression of every target that there are samples of.

    Args:
        gram: `[T, 1 + d, 1 + d]`, see `solve_linear`.
        moment: `[T, 1 + d]`.
        count: `[T]` samples.
        origin: See there.
        centre: See there.
        shrink: See there.
        ridge: See there.
        prior: `[T, 1 + d]`.
        out: `[T, 1 + d]` receives the weights.
    """
    for t in range(count.shape[0]):
        if count[t] > 0:
            solve_linear(gram[t], moment[t], origin, centre, shrink, ridge, prior[t], out[t])


@cached_njit(nogil=True)
def accumulate_waves(x, y, features, gram, moment):
    """Add one sample to the statistics of (1, x, features): `[D, D]` and `[D, T]`.

    The inputs x are those less the origin.
    """
    depth, waves = x.shape[0], features.shape[0]
    size = 1 + depth + waves
    row = np.empty(size)
    row[0] = 1.0
    for i in range(depth):
        row[1 + i] = x[i]
    for k in range(waves):
        row[1 + depth + k] = features[k]
    for i in range(size):
        a = row[i]
        for j in range(i + 1):
            gram[i, j] += a * row[j]
        for t in range(y.shape[0]):
            moment[i, t] += a * y[t]
