from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.adaptation.residual.warm_up import WarmUp
from tests.generated.profile import examples

SAMPLES = 10


def warm_up(x: np.ndarray, y: np.ndarray) -> WarmUp:
    """One of two inputs, and a target, which is the second of them."""
    first = WarmUp(2, np.array([1]))
    for k in range(SAMPLES):
        first.add(x[k], y[k], np.array([True]), np.array([0.1]))
    return first


def cleaned(first: WarmUp, *others: WarmUp) -> list[tuple[np.ndarray, ...]] | None:
    samples = first.without_outliers([first, *others])
    return None if samples is None else list(samples)


def numbers(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(SAMPLES, 2)), 0.1 * rng.normal(size=(SAMPLES, 1))


@given(seed=st.integers(0, 2**32), scale=st.sampled_from([1e-12, 1.0, 1e12]))
@examples(50)
def test_nothing_usual_is_wild(seed: int, scale: float) -> None:
    """Neither noise, nor what is usually nothing, nor a growing oscillation, nor a truth value."""
    rng = np.random.default_rng(seed)
    x, y = numbers(seed)
    grows = (-1.5) ** np.arange(SAMPLES)
    seldom, truth = np.zeros(SAMPLES), np.zeros(SAMPLES)
    seldom[rng.integers(SAMPLES)], truth[rng.integers(SAMPLES)] = 0.5, 1.0
    for first in (x[:, 0], grows, truth, np.full(SAMPLES, 0.3)):
        for target in (y[:, 0], x[:, 1], seldom):
            inputs = np.stack((first, scale * x[:, 1]), axis=1)
            assert cleaned(warm_up(inputs, scale * target[:, None])) is None


@pytest.mark.parametrize("wild", [range(6, 10), range(2, 6), range(8, 10), range(9, 10)])
def test_what_lasts_or_may_last_is_not_wild(wild: range) -> None:
    x, y = numbers(0)
    x[list(wild), 0] += 1000.0
    assert cleaned(warm_up(x, y)) is None


def test_what_one_action_alone_seldom_meets_is_not_wild() -> None:
    """Of two places that are far apart, each action is mostly taken in one."""
    x, y = numbers(0)
    one, other = x.copy(), x.copy()
    one[[2, 5], 0] += 1000.0
    other[[0, 1, 2, 5, 6, 8], 0] += 1000.0
    assert cleaned(warm_up(one, y)) is not None
    assert cleaned(warm_up(one, y), warm_up(other, y)) is None
