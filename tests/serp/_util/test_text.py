"""Words and numbers in messages."""

import math

from serp._util.text import did_you_mean, duration, percent, readable


def test_advice_lists_a_few_known_names_when_none_is_close() -> None:
    assert did_you_mean("sped", ["speed", "charge"]) == "did you mean `speed`?"
    assert did_you_mean("xyz", ["speed", "charge"]) == "known here: `charge`, `speed`"
    assert did_you_mean("xyz", [f"f{k}" for k in range(20)]).endswith("`f15` and 12 more")
    assert did_you_mean("xyz", []) == ""


def test_numbers_are_written_for_people() -> None:
    shares = [percent(share) for share in (0.0, 1e-6, 0.00123, 0.0999, 0.9999, 12.3456)]
    assert shares == ["0 %", "< 0.01 %", "0.12 %", "10 %", "100 %", "1,235 %"]
    times = [duration(seconds) for seconds in (8.21, 59.96, 185, 3599.7, 400_000)]
    assert times == ["8.2 s", "1 min 00 s", "3 min 05 s", "1 h 00 min", "111 h 06 min"]
    values = (None, math.nan, -0.0, 0.261799, 1234567, 1e300, -1234.5, -math.inf)
    words = ["–", "–", "0", "0.2618", "1,234,567", "1e+300", "−1,234", "−inf"]
    assert [readable(value) for value in values] == words
