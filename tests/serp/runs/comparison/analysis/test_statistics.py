from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.runs.comparison.statistics import (
    difference,
    estimate,
    interquartile_band,
    interquartile_mean,
    mean,
    standard_deviation,
    times,
)

samples = st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=1, max_size=12)


@settings(max_examples=60, deadline=None)
@given(samples, st.sampled_from([mean, interquartile_mean]), st.randoms())
def test_an_interval_holds_its_estimate_and_ignores_the_order_of_seeds(values, statistic, random):
    found = estimate(values, statistic)
    if len(values) > 1:
        assert min(values) - 1e-6 <= found.low <= found.value <= found.high <= max(values) + 1e-6
    else:
        assert (found.low, found.high) == (None, None)
    assert estimate(random.sample(values, len(values)), statistic) == found


@settings(max_examples=40, deadline=None)
@given(samples, samples)
def test_a_difference_turns_its_sign_with_its_sides(first, second):
    one, other = difference(first, second), difference(second, first)
    assert one.value == -other.value
    assert (one.low is None) == (min(len(first), len(second)) < 2)
    if one.low is not None:
        assert one.low <= one.value <= one.high


def test_coverage_of_the_interval_of_the_mean():
    """Of many samples about 95 % have an interval that holds the truth (a bit less for ten)."""
    rng = np.random.default_rng(0)
    found = [estimate(rng.normal(3, 1, 20), mean) for _ in range(150)]
    held = np.mean([one.low <= 3 <= one.high for one in found])
    assert 0.87 < held < 0.99


def test_degenerate_samples_have_a_defined_answer():
    assert np.isnan(estimate([]).value) and estimate([])[1:] == (None, None)
    assert estimate([7.0]) == (7.0, None, None)
    assert estimate([7.0] * 5) == (7.0, 7.0, 7.0)
    assert estimate([np.nan, 2.0, 2.0]) == (2.0, 2.0, 2.0)
    assert estimate([np.inf, 1.0, 2.0]) == (np.inf, None, None)
    assert np.isnan(estimate([np.inf, -np.inf], mean).value)
    assert difference([1.0, 2.0], [5.0]) == (-3.5, None, None)
    assert np.isnan(difference([1.0, 2.0], []).value)
    assert standard_deviation(np.array([3.0])) == 0
    assert np.isnan(standard_deviation(np.zeros(0)))


@given(st.lists(st.one_of(st.floats(0, 1e6), st.just(float("inf"))), max_size=12))
@settings(max_examples=60, deadline=None)
def test_times_count_never_and_their_median_is_one_of_all_trials(values):
    found = times(values)
    assert found.trials == len(values)
    assert found.never == sum(map(np.isinf, values))
    if values:
        assert found.median == np.median(values)
    if len(values) > 1:
        assert found.low <= found.median <= found.high
        if found.never == len(values):
            assert np.isinf(found.low)


def test_bands_lie_around_their_centre_and_agree_with_estimates():
    curves = np.random.default_rng(1).normal(size=(8, 5)).cumsum(axis=1)
    band = interquartile_band(curves)
    assert (band.low <= band.centre).all() and (band.centre <= band.high).all()
    assert band.centre == pytest.approx(interquartile_mean(curves.T))
    one = estimate(curves[:, 2])
    assert (band.low[2], band.high[2]) == pytest.approx((one.low, one.high), abs=0.15)
    assert interquartile_band(curves[::-1]).low == pytest.approx(band.low)


def test_bands_of_one_seed_are_its_curve_and_of_none_are_nothing():
    curve = np.array([[1.0, 2.0, 3.0]])
    assert all((edge == curve[0]).all() for edge in interquartile_band(curve))
    assert np.isnan(interquartile_band(np.zeros((0, 3))).centre).all()
