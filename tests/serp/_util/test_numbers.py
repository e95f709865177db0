"""Numbers as users give them, and the largest of several."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from serp._util.numbers import best_of, seed_of
from serp.errors import SettingsError


def test_any_whole_number_is_a_seed_and_nothing_else_is():
    assert (seed_of(np.int64(7)), seed_of(2**200)) == (7, 2**200)
    for value in (1.5, None, -1, "3", True, np.float64(2)):
        with pytest.raises(SettingsError, match="the seed must be a whole number, 0 or more, not "):
            seed_of(value)


numbers = st.sampled_from([-math.inf, math.inf, math.nan, 0.0, 1.0, -1e39]) | st.floats()


@given(st.lists(numbers, min_size=1, max_size=6), st.sampled_from([np.float32, np.float64]))
@example([math.nan, -math.inf], np.float32)
def test_no_value_is_better_than_the_best(found, kind):
    with np.errstate(over="ignore"):
        values = np.array(found, dtype=kind)
    # Numbers before NaN, the larger before the smaller, the first before its equals.
    ranks = [(not math.isnan(v), -math.inf if math.isnan(v) else v) for v in values.tolist()]
    assert best_of(values) == max(range(len(values)), key=lambda k: (ranks[k], -k))
