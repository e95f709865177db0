"""Numbers, terms and comments as PDDL text: plain decimals, binary arithmetic, ASCII."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable

from serp.diagnosis.findings import EffectTerm

_DIGITS = 4  # most significant ones
_WIDTH = 100
_PLAIN = str.maketrans({"−": "-", "…": "...", "×": "*", "±": "+/-"})


def decimal(value: float, error: float) -> str:
    """Format a number up to the first uncertain digit, with at most four digits.

    A plain decimal, as every PDDL tool reads it: `0.21`, `-3`, never an exponent.

    Args:
        value: The number.
        error: Its standard error; 0 for none.
    """
    if value == 0.0:
        return "0"
    most = _DIGITS - 1 - math.floor(math.log10(abs(value)))
    decimals = most
    if error > 0.0 and math.isfinite(error):
        decimals = min(most, -math.floor(math.log10(error)))
    rounded = round(value, decimals)
    if rounded == 0.0:  # no digit is certain: show the order of magnitude
        decimals = -math.floor(math.log10(abs(value)))
        rounded = round(value, decimals)
    text = f"{rounded:.{max(0, decimals)}f}"
    if decimals == most and "." in text:
        text = text.rstrip("0").rstrip(".")
    return text


def effect_of(target: str, term: EffectTerm, *, rate: bool) -> str:
    """Return `(increase (f) ...)` or `(decrease (f) ...)` for one term.

    Args:
        target: Name of the fluent, `battery ?robot`.
        term: The term that changes it.
        rate: Whether it is a change per unit of time, as in a process.
    """
    value = _product(abs(term.coefficient), term)
    if rate:
        value = f"(* #t {value})"
    return f"({'decrease' if term.coefficient < 0 else 'increase'} ({target}) {value})"


def plus(value: str, terms: Iterable[EffectTerm]) -> str:
    """Return the expression of a value with terms added to it, in binary arithmetic."""
    for term in terms:
        operator = "-" if term.coefficient < 0 else "+"
        value = f"({operator} {value} {_product(abs(term.coefficient), term)})"
    return value


def _product(coefficient: float, term: EffectTerm) -> str:
    """Return a coefficient, which is not negative, times the fluents of a term."""
    number = decimal(coefficient, term.error)
    fluents = ""
    for name in term.fluents:
        fluents = f"(* {fluents} ({name}))" if fluents else f"({name})"
    if not fluents:
        return number
    return fluents if number == "1" else f"(* {number} {fluents})"


def comment(text: str, indent: str, newline: str) -> str:
    """Return comment lines, each with the indent and a line break at its end."""
    width = max(40, _WIDTH - len(indent) - 2)
    plain = text.translate(_PLAIN)
    lines = textwrap.wrap(plain, width, break_long_words=False, break_on_hyphens=False)
    return "".join(f"{indent}; {line}{newline}" for line in lines)
