"""Robust regression towards what is believed already."""

from __future__ import annotations

import numpy as np
import pytest

from serp.model.learned.robust_regression import Regression, regress

TRUTH = np.array([0.5, -2.0])


def fitted(
    columns: np.ndarray,
    target: np.ndarray,
    *,
    blocks: np.ndarray | None = None,
    reject: bool = True,
) -> Regression:
    number, count = columns.shape
    return regress(
        columns, target, centre=np.zeros(count), width=np.full(count, 100.0),
        groups=np.zeros(number, dtype=np.int64),
        blocks=np.arange(number) if blocks is None else blocks, unit=1.0, reject=reject,
    )  # fmt: skip


def drawn(rng: np.random.Generator, number: int) -> np.ndarray:
    return np.stack([np.ones(number), rng.normal(size=number)], axis=1)


@pytest.mark.parametrize("kind", ["equal", "unequal", "neighbours alike"])
def test_standard_errors_are_those_of_the_estimates(kind: str) -> None:
    rng = np.random.default_rng(0)
    off = []
    for _ in range(150):
        columns = drawn(rng, 400)
        errors = rng.normal(scale=0.1, size=400)
        if kind == "unequal":
            errors *= 0.3 + np.abs(columns[:, 1])
        if kind == "neighbours alike":
            errors = np.repeat(rng.normal(scale=0.1, size=20), 20)
        fit = fitted(columns, columns @ TRUTH + errors, blocks=np.arange(400) // 20)
        off.append((fit.coefficients - TRUTH) / fit.errors)
    assert 0.8 < np.std(off) < 1.3
    assert abs(np.mean(off)) < 0.3


def test_a_few_wild_rows_move_nothing() -> None:
    rng = np.random.default_rng(1)
    columns = drawn(rng, 500)
    target = columns @ TRUTH + rng.normal(scale=0.01, size=500)
    target[:8] += 1e6
    fit = fitted(columns, target)
    assert fit.coefficients == pytest.approx(TRUTH, abs=0.005)
    assert (fit.weights[:8] == 0.0).all() and fit.weights[8:].min() > 0.2
    # Weighed down at least, where none may be left out.
    kept = fitted(columns, target, reject=False)
    assert (kept.weights[:8] > 0.0).all()
    assert kept.coefficients == pytest.approx(TRUTH, abs=0.05)


def test_what_is_rare_is_no_outlier() -> None:
    rng = np.random.default_rng(2)
    rare = (np.arange(600) % 15 == 0).astype(float)
    target = 3.0 * rare + rng.normal(scale=0.01, size=600)
    assert fitted(rare[:, None], target).coefficients == pytest.approx([3.0], abs=0.01)
