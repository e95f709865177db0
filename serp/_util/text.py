"""Parts of messages: counts, numbers, shares and durations in words."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable


def plural(count: int, noun: str, several: str | None = None) -> str:
    """Return a count with its noun: `1 action`, `3 actions`."""
    return f"{count:,} {noun if count == 1 else several or noun + 's'}"


def readable(value: float | None) -> str:
    """Return a number with four significant digits: `1,234`, `−0.2618`, `–` for none; or `true`."""
    if isinstance(value, bool):
        return str(value).lower()
    if value is None or math.isnan(value):
        return "–"
    if isinstance(value, int) or 1e3 <= abs(value) < 1e9:
        return _minus(f"{value:,.0f}")
    return _minus(f"{value + 0.0:.4g}")


def plain(value: float) -> str:
    """Return a number with six significant digits."""
    return f"{value + 0.0:.6g}"


def measured(value: float, error: float) -> str:
    """Return a value with its standard error: `0.21 ± 0.02`."""
    decimals = _decimals(value, error)
    if decimals is None:
        return _minus(plain(value))
    return f"{_minus(_fixed(value, decimals))} ± {_fixed(round(error, decimals), decimals)}"


def percent_measured(share: float, error: float) -> str:
    """Return a share of 1 with its standard error in percent: `33 ± 2 %`."""
    if not math.isfinite(error) or error < 0.0005:
        return f"{100 * share:.1f} %" if 0 < share < 0.1 else f"{100 * share:.0f} %"
    decimals = 1 if error < 0.005 else 0
    return f"{100 * share:.{decimals}f} ± {100 * error:.{decimals}f} %"


def percent(share: float) -> str:
    """Return a share of 1 in percent with two significant digits, such as `1.3 %`.

    An integer part is shown in full, a share below 0.01 % as such.
    """
    value = 100 * share
    if 0 < value < 0.01:
        return "< 0.01 %"
    return f"{value:,.0f} %" if value >= 10 else f"{value:.2g} %"


def duration(seconds: float) -> str:
    """Return a time for people to read: ``8.2 s``, ``3 min 05 s``, ``2 h 07 min``."""
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02} s"
    return f"{minutes // 60} h {minutes % 60:02} min"


def sparkline(numbers: Iterable[float]) -> str:
    """Return the course of numbers as at most 12 bars; an empty text for fewer than three.

    Each bar is the mean of as many values; the lowest and the highest bar are the ends of the
    scale (Tufte 2006).
    """
    values, shapes = list(numbers), "▁▂▃▄▅▆▇█"
    if len(values) < 3 or not all(map(math.isfinite, values)):
        return ""
    bars = min(12, len(values))
    ends = [len(values) * i // bars for i in range(bars + 1)]
    means = [sum(values[a:b]) / (b - a) for a, b in itertools.pairwise(ends)]
    low, spread = min(means), max(means) - min(means)
    if spread <= 1e-9 * max(map(abs, means)):
        return shapes[3] * len(means)
    return "".join(shapes[min(int((mean - low) / spread * 8), 7)] for mean in means)


def _decimals(value: float, error: float) -> int | None:
    """Return the decimals up to the first digit of an error, or to the second if the first is 1.

    None if the error is negligible, unknown, or smaller than six decimals show.
    """
    if not math.isfinite(error) or error <= 1e-9 * abs(value):
        return None
    place = math.floor(math.log10(error))
    first = int(error / 10.0**place)
    decimals = -place + (1 if first == 1 else 0)
    return decimals if decimals <= 6 else None


def _fixed(value: float, decimals: int) -> str:
    if decimals < 0 and abs(value) >= 1e9:
        return f"{value:.3g}"
    return f"{round(value, decimals) + 0.0:,.{max(0, decimals)}f}"


def _minus(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text
