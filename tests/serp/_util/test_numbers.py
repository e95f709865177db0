"""Numbers as users give them, and the largest of several."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp._util.numbers import best_of, real, seed_of, whole
from serp.errors import SettingsError

NO_NUMBERS: list[Any] = [None, True, np.True_, "3", [3], np.array([3]), Decimal(3), 1j, math.nan]


@pytest.mark.parametrize("value", [3, np.int64(3), np.uint8(3)])
def test_whole_numbers_become_ints(value: Any) -> None:
    assert whole(value, 0) == 3
    assert type(whole(value, 0)) is int
    assert whole(value, 4) is None
    assert type(real(value)) is int


@pytest.mark.parametrize("value", [0.5, np.float32(0.5), np.float64(0.5), Fraction(1, 2)])
def test_numbers_become_floats_and_are_not_whole(value: Any) -> None:
    assert real(value) == 0.5
    assert type(real(value)) is float
    assert whole(value, 0) is None


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_number_is_none(value: Any) -> None:
    assert whole(value, 0) is None
    assert real(value) is None
    assert real(value, infinite=True) is None


def test_infinities_count_where_they_may() -> None:
    for value in (math.inf, -math.inf, np.float32(math.inf)):
        assert real(value) is None
        assert real(value, infinite=True) == value
    assert real(10**400) is None


@pytest.mark.parametrize("value", [1.5, None, -1, "3", True, np.float64(2)])
def test_what_is_no_seed_is_refused_with_its_value(value: Any) -> None:
    with pytest.raises(SettingsError, match="the seed must be a whole number, 0 or more, not "):
        seed_of(value)


def test_any_whole_number_is_a_seed() -> None:
    assert seed_of(np.int64(7)) == 7
    assert seed_of(2**200) == 2**200


pairs = st.lists(
    st.tuples(
        st.sampled_from([-math.inf, math.inf, math.nan, 0.0, 1.0, -1e39]) | st.floats(),
        st.booleans(),
    ),
    min_size=1,
    max_size=6,
)


@given(pairs, st.sampled_from([np.float32, np.float64]))
def test_the_best_is_allowed_and_no_allowed_one_is_better(
    pairs: list[tuple[float, bool]], kind: type[np.floating]
) -> None:
    with np.errstate(over="ignore"):
        values = np.array([value for value, _ in pairs], dtype=kind)
    among = np.array([allowed for _, allowed in pairs])
    best = best_of(values, among)
    if not among.any():
        assert best == -1
        return
    assert among[best]
    # Numbers before NaN, the larger before the smaller, the first before its equals.
    ranks = [(not math.isnan(v), -math.inf if math.isnan(v) else v) for v in values.tolist()]
    assert best == max(np.flatnonzero(among).tolist(), key=lambda k: (ranks[k], -k))
    assert best_of(values) == best_of(values, np.ones(len(values), bool))
