"""Robust linear regression with a Gaussian prior and robust standard errors.

Huber weights at first, then rejection of outliers (Huber & Ronchetti, Robust Statistics, 2009,
chapters 4 and 7). Standard errors by the sandwich estimator over blocks of neighbouring rows
(Liang & Zeger, Biometrika 73, 1986), which is valid for heteroscedastic and correlated errors, such
as those of a wrong model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import Vector

CERTAIN = 4.0
"""Standard errors at which a deviation is certain: a file has many parameters, so false findings
must be rare."""
_HUBER, _REJECTED = 2.0, 6.0
"""Robust scales beyond which a row is down-weighted, and beyond which it is rejected."""
_COLLINEAR = 1e-3
"""Fraction of a column not explained by other columns; below it they are collinear."""


@dataclass(frozen=True)
class Regression:
    """A fitted linear model.

    `coefficients` and their standard `errors` are `[K]`; where the rows hold no information the
    error is the width of the prior. `residuals` and `weights`, 0 (rejected) to 1, are `[n]`.
    """

    coefficients: Vector
    errors: Vector
    residuals: Vector
    weights: Vector


def regress(
    columns: Vector,
    target: Vector,
    *,
    centre: Vector,
    width: Vector,
    groups: NDArray[np.int64],
    blocks: NDArray[np.int64],
    unit: float,
    reject: bool = True,
) -> Regression:
    """Fit `target ≈ columns @ coefficients`, `[n]` and `[n, K]`; `unit` is the target's range.

    The prior has mean `centre` and standard deviation `width`, `[K]` each. Rows with an equal group
    `[n]` have errors of the same scale, those with an equal block `[n]` correlated ones. Outliers
    are down-weighted and, with `reject`, then rejected.
    """
    number = len(columns)
    weights = np.ones(number)
    coefficients = centre.copy()
    rounding = 1e-10 * unit
    scale = max(float(np.sqrt(np.mean(target**2))) if number else 0.0, rounding)
    members = [np.flatnonzero(groups == group) for group in np.unique(groups)]
    for turn in range(10):
        before = coefficients
        residuals = target - columns @ coefficients
        if turn:
            limits = _robust_scales(residuals, members, rounding)
            weights = np.minimum(1.0, _HUBER * limits / np.maximum(np.abs(residuals), rounding))
            if reject and turn > 2:
                weights[np.abs(residuals) > _REJECTED * limits] = 0.0
            total = max(float(weights.sum()), 1.0)
            scale = max(float(np.sqrt((weights * residuals**2).sum() / total)), rounding)
        coefficients = _solve(columns, residuals, weights, coefficients, centre, width, scale)
        moved, size = np.abs(coefficients - before), np.abs(coefficients).max(initial=1e-300)
        if turn > 3 and moved.max(initial=0.0) <= 1e-9 * size:
            break
    residuals = target - columns @ coefficients
    errors = _standard_errors(columns, residuals, weights, width, scale, blocks)
    return Regression(coefficients, errors, residuals, weights)


def independent(columns: Vector, width: Vector) -> list[int]:
    """Return a maximal set of linearly independent columns `[n, K]`, chosen by size.

    Of two parameters that are multiplied with each other, for example, only one can be estimated.
    Columns whose numbers are too large to calculate with are left out.
    """
    if not columns.size:
        return []
    from scipy.linalg import qr

    scaled = columns * width
    scaled[:, ~np.isfinite(np.linalg.norm(scaled, axis=0))] = 0.0
    triangle, order = qr(scaled, mode="r", pivoting=True)
    sizes, norms = np.abs(np.diag(triangle)), np.linalg.norm(scaled, axis=0)[order]
    return sorted(order[: len(sizes)][sizes > _COLLINEAR * norms[: len(sizes)]].tolist())


def _robust_scales(residuals: Vector, members: list[NDArray[np.int64]], least: float) -> Vector:
    """Return a robust scale `[n]` of the errors of each row's group; `members` are their rows.

    The larger of the scaled median and of the root mean square of all but the largest 2 %: a rare
    effect is not an outlier. Groups of fewer than 10 rows have no outliers.
    """
    scales = np.full(len(residuals), np.inf)
    for rows in members:
        sizes = np.sort(np.abs(residuals[rows]))
        if len(sizes) >= 10:
            kept = sizes[: int(np.ceil(len(sizes) * 0.98))]
            half = len(sizes) // 2
            median = float((sizes[half] + sizes[-1 - half]) / 2)
            scales[rows] = max(1.4826 * median, float(np.sqrt(np.mean(kept**2))), least)
    return scales


def _solve(
    columns: Vector,
    residuals: Vector,
    weights: Vector,
    before: Vector,
    centre: Vector,
    width: Vector,
    scale: float,
) -> Vector:
    """Return the coefficients of weighted least squares with the prior, by normal equations."""
    scaled = columns * (width / scale)
    weighted = scaled * weights[:, None]
    matrix = weighted.T @ scaled + np.eye(len(before))
    slope = weighted.T @ (residuals / scale) - (before - centre) / width
    size = np.sqrt(np.diag(matrix))
    step: Vector = np.linalg.solve(matrix / np.outer(size, size), slope / size) / size
    return before + step * width


def _standard_errors(
    columns: Vector,
    residuals: Vector,
    weights: Vector,
    width: Vector,
    scale: float,
    blocks: NDArray[np.int64],
) -> Vector:
    """Return the standard errors, computed in widths of the prior."""
    count = columns.shape[1]
    used = int((weights > 0).sum())
    if count == 0 or used <= count + 1:
        return np.full(count, np.inf)
    scaled = columns * width / scale
    bread = np.linalg.pinv((scaled * weights[:, None]).T @ scaled + np.eye(count), hermitian=True)
    scores = scaled * (weights * residuals / scale)[:, None]
    _, which = np.unique(blocks, return_inverse=True)
    number = int(which.max()) + 1
    if number < 3 * count + 5:  # too few blocks: use single rows
        number, which = len(scores), np.arange(len(scores))
    sums = np.zeros((number, count))
    np.add.at(sums, which, scores)
    factor = used / (used - count) * number / max(number - 1, 1)
    covariance = bread @ (sums.T @ sums * factor + np.eye(count)) @ bread
    errors: Vector = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * width
    return errors
