from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.learned.residual_fit import FIRST, outliers
from tests.generated.profile import examples


def drops(x: np.ndarray, y: np.ndarray, *others: np.ndarray) -> bool:
    """Whether anything of samples of one action is dropped; the target is the last input."""
    valid, places = np.ones(y.shape, dtype=bool), np.array([x.shape[1] - 1])
    dropped, used = outliers(x, np.concatenate((x, *others)), y, valid, places)
    return bool(dropped.any() or not used.all())


def numbers(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(FIRST, 2)), 0.1 * rng.normal(size=(FIRST, 1))


@given(seed=st.integers(0, 2**32), scale=st.sampled_from([1e-12, 1.0, 1e12]))
@examples(50)
def test_nothing_usual_is_wild(seed: int, scale: float) -> None:
    """Neither noise, nor what is usually nothing, nor a growing oscillation, nor a truth value."""
    rng = np.random.default_rng(seed)
    x, y = numbers(seed)
    grows = (-1.5) ** np.arange(FIRST)
    seldom, truth = np.zeros(FIRST), np.zeros(FIRST)
    seldom[rng.integers(FIRST)], truth[rng.integers(FIRST)] = 0.5, 1.0
    for first in (x[:, 0], grows, truth, np.full(FIRST, 0.3)):
        for target in (y[:, 0], x[:, 1], seldom):
            inputs = np.stack((first, scale * x[:, 1]), axis=1)
            assert not drops(inputs, scale * target[:, None])


@pytest.mark.parametrize("wild", [range(6, 10), range(2, 6), range(8, 10), range(9, 10)])
def test_what_lasts_or_may_last_is_not_wild(wild: range) -> None:
    x, y = numbers(0)
    x[list(wild), 0] += 1000.0
    assert not drops(x, y)


def test_what_one_action_alone_seldom_meets_is_not_wild() -> None:
    """Of two places that are far apart, each action is mostly taken in one."""
    x, y = numbers(0)
    one, other = x.copy(), x.copy()
    one[[2, 5], 0] += 1000.0
    other[[0, 1, 2, 5, 6, 8], 0] += 1000.0
    assert drops(one, y)
    assert not drops(one, y, other)
