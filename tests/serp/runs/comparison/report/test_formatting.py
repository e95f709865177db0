from __future__ import annotations

import numpy as np

from serp.runs.comparison.statistics import Estimate, Times, times
from serp.runs.comparison.tables import NOTHING, estimate_text, number, spread_text, times_text


def test_numbers_have_the_digits_that_count():
    assert number(None) == number(float("nan")) == NOTHING
    assert number(12345.6) == "12,346"
    assert number(475.0) == "475"
    assert number(-0.12345) == "−0.123"
    assert number(np.inf) == "∞"


def test_estimates_share_their_decimals():
    assert estimate_text(Estimate(482.123, 471.0, 495.26)) == "482.1 [471.0, 495.3]"
    assert estimate_text(Estimate(1.5, None, None), signed=True) == "+1.50"
    assert estimate_text(Estimate(-0.001, -50.0, 50.0), signed=True) == "0.0 [−50.0, +50.0]"
    assert estimate_text(Estimate(np.nan, None, None)) == NOTHING
    assert spread_text(480.31, 12.06) == "480.3 ± 12.1"


def test_never_is_counted():
    assert times_text(times([])) == NOTHING
    assert times_text(times([np.inf] * 3)) == "never (3 of 3)"
    assert times_text(Times(np.inf, np.inf, np.inf, 9, 10)) == "never (9 of 10)"
    assert times_text(Times(5000.0, 4000.0, np.inf, 2, 10)) == (
        "5,000 [4,000, never], never in 2 of 10"
    )
    assert times_text(times([700.0])) == "700"
    assert times_text(times([np.nan])) == NOTHING
