"""How often each of several outcomes comes, where what is seen may fit more than one of them.

The estimate of greatest likelihood, by expectation and maximisation (Dempster, Laird & Rubin,
Journal of the Royal Statistical Society B 39, 1977).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import Vector

_TURNS = 500


def likeliest(fits: NDArray[np.bool_]) -> tuple[Vector, Vector]:
    """Return how often each outcome comes, and standard errors.

    Args:
        fits: `[n, K]`, whether an outcome is what was observed; rows that none fits count as
            something else, so that the shares add up to less than 1.

    Returns:
        Shares `[K]` and their standard errors `[K]`.
    """
    number, count = fits.shape
    known = fits[fits.any(1)].astype(np.float64)
    if not len(known):
        return np.zeros(count), np.full(count, 1.0 / max(number, 1))
    shares = np.full(count, 1.0 / count)
    for _ in range(_TURNS):
        parts = known * shares
        parts /= parts.sum(1, keepdims=True)
        before, shares = shares, parts.mean(0)
        if np.abs(shares - before).max() < 1e-9:
            break
    # The observed information, along the directions in which the shares still add up to one.
    scores = known / (known @ shares)[:, None]
    alive = shares > 1e-6
    along = np.eye(count)[:, alive] - alive[:, None] / alive.sum()
    information = along.T @ scores.T @ scores @ along
    covariance = along @ np.linalg.pinv(information, hermitian=True) @ along.T
    share = len(known) / number
    variance = np.maximum(np.diag(covariance), 0.0) * share**2
    variance += shares**2 * share * (1.0 - share) / number
    return shares * share, np.sqrt(variance + 1.0 / number**2)
