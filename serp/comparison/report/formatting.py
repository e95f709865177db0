"""Numbers, estimates and seeds as a report shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from serp.comparison.analysis.statistics import Estimate, Times

NOTHING: Final = "–"


def number(value: float | None) -> str:
    """Return a number with three or four digits that count; a dash for none."""
    if value is None or math.isnan(value):
        return NOTHING
    return _fixed(value, _decimals([value]))


def estimate_text(found: Estimate, *, signed: bool = False) -> str:
    """Return a value with its interval, if it has one, such as `482.1 [471.0, 495.2]`."""
    if math.isnan(found.value):
        return NOTHING
    numbers = [end for end in found if end is not None]
    decimals = _decimals(numbers)
    value, *ends = (_fixed(end, decimals, signed=signed) for end in numbers)
    return f"{value} [{', '.join(ends)}]" if ends else value


def spread_text(mean: float, deviation: float) -> str:
    """Return a mean with its deviation: `480.3 ± 12.1`."""
    if math.isnan(mean):
        return NOTHING
    decimals = _decimals([mean, deviation])
    return f"{_fixed(mean, decimals)} ± {_fixed(deviation, decimals)}"


def times_text(found: Times) -> str:
    """Return the median, its interval and how often it never happened.

    Such as `12,000 [9,000, never], never in 3 of 10` or `never (8 of 10)`.
    """
    if not found.trials:
        return NOTHING
    if math.isinf(found.median) and (found.low is None or math.isinf(found.low)):
        return f"never ({found.never} of {found.trials})"
    text = _time(found.median)
    if found.low is not None and found.high is not None:
        text += f" [{_time(found.low)}, {_time(found.high)}]"
    if found.never:
        text += f", never in {found.never} of {found.trials}"
    return text


def seeds_text(seeds: Sequence[int]) -> str:
    """Return seeds as a range where they are one: `0 to 4`, `1, 7`."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def _time(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:,.0f}"


def _decimals(values: Sequence[float]) -> int:
    """Return how many decimals leave the largest of some values about four digits, at least."""
    finite = [float(value) for value in values if math.isfinite(value)]
    size = max(map(abs, finite), default=0.0)
    if size == 0 or size >= 1000 or all(value.is_integer() for value in finite):
        return 0
    return min(4, max(1, 2 - math.floor(math.log10(size))))


def _fixed(value: float, decimals: int, *, signed: bool = False) -> str:
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:{'+' if signed else ''},.{decimals}f}"
    if float(text.replace(",", "")) == 0:
        text = text.lstrip("+-")
    return text.replace("-", "−")
