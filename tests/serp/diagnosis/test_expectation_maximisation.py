"""Probabilities of outcomes from ambiguous observations."""

from __future__ import annotations

import numpy as np

from serp.diagnosis.expectation_maximisation import estimate_probabilities


def test_shares_are_recovered_within_their_errors() -> None:
    rng = np.random.default_rng(0)
    truth = np.array([0.5, 0.3, 0.2])
    drawn = rng.choice(3, p=truth, size=2_000)
    fits = np.eye(3, dtype=np.bool_)[drawn]
    walls = rng.random(2_000) < 0.4  # there, the first two look alike
    fits[walls & (drawn < 2), :2] = True
    shares, errors = estimate_probabilities(fits)
    assert (np.abs(shares - truth) < 4.0 * errors).all()
    assert (errors < 0.03).all()


def test_what_no_outcome_fits_is_something_else() -> None:
    shares, _ = estimate_probabilities(np.zeros((10, 2), dtype=np.bool_))
    assert (shares == 0.0).all()
