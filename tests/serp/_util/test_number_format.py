"""Numbers, shares and times as people read them."""

from __future__ import annotations

import pytest

from serp._util.text import duration, percent, readable


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.0, "0 %"),
        (1e-6, "< 0.01 %"),
        (0.00123, "0.12 %"),
        (0.0999, "10 %"),
        (0.1234, "12 %"),
        (0.9999, "100 %"),
        (12.3456, "1,235 %"),
    ],
)
def test_shares_are_shown_with_two_significant_digits(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (8.21, "8.2 s"),
        (59.96, "1 min 00 s"),
        (185, "3 min 05 s"),
        (3599.7, "1 h 00 min"),
        (400_000, "111 h 06 min"),
    ],
)
def test_durations_are_written_for_people(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (-0.0, "0"),
        (0.261799, "0.2618"),
        (1234.5, "1,234"),
        (1234567, "1,234,567"),
        (1e300, "1e+300"),
        (-1234.5, "−1,234"),
        (float("-inf"), "−inf"),
    ],
)
def test_numbers_are_written_for_people(value: float | None, text: str) -> None:
    assert readable(value) == text
