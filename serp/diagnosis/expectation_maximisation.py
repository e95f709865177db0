"""Expectation-maximisation for the probabilities of outcomes, from ambiguous observations.

A maximum-likelihood estimate (Dempster, Laird & Rubin, Journal of the Royal Statistical Society
B 39, 1977).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import Vector

_ITERATIONS = 500


def estimate_probabilities(fits: NDArray[np.bool_]) -> tuple[Vector, Vector]:
    """Return the probabilities of outcomes and their standard errors.

    Args:
        fits: `[n, K]`, whether an outcome fits the observation. Rows that fit no outcome count as
            another outcome: the probabilities then add up to less than 1.

    Returns:
        Probabilities `[K]` and standard errors `[K]`.
    """
    number, count = fits.shape
    known = fits[fits.any(1)].astype(np.float64)
    if not len(known):
        return np.zeros(count), np.full(count, 1.0 / max(number, 1))
    shares = np.full(count, 1.0 / count)
    for _ in range(_ITERATIONS):
        parts = known * shares
        parts /= parts.sum(1, keepdims=True)
        before, shares = shares, parts.mean(0)
        if np.abs(shares - before).max() < 1e-9:
            break
    # The observed information along the directions that keep the sum of the probabilities.
    scores = known / (known @ shares)[:, None]
    alive = shares > 1e-6
    along = np.eye(count)[:, alive] - alive[:, None] / alive.sum()
    information = along.T @ scores.T @ scores @ along
    covariance = along @ np.linalg.pinv(information, hermitian=True) @ along.T
    share = len(known) / number
    variance = np.maximum(np.diag(covariance), 0.0) * share**2
    variance += shares**2 * share * (1.0 - share) / number
    return shares * share, np.sqrt(variance + 1.0 / number**2)
