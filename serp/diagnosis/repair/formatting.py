"""Numbers, terms and evidence as PDDL text: plain decimals, binary arithmetic, ASCII comments."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable

from serp.diagnosis.findings import EffectTerm, RuleFinding, StochasticEffect
from serp.sysid.monitor import END

_DIGITS = 4
"""Most significant digits."""
_WIDTH = 100
_PLAIN = str.maketrans({"−": "-", "…": "...", "×": "*", "±": "+/-"})
"""Some PDDL tools read only ASCII."""


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


def measured(value: float, error: float) -> str:
    """Format a number for a comment, with its standard error if visible: `0.21 +/- 0.02`."""
    number = decimal(value, error)
    decimals = len(number.partition(".")[2])
    if error < 0.5 * 10.0**-decimals and float(number) != 0.0:
        return number
    return f"{number} +/- " + (f"{error:.{decimals}f}" if decimals else decimal(error, error))


def evidence_of_term(term: EffectTerm, samples: int, *, rate: bool) -> str:
    """Return the evidence for a new effect, for a comment above it."""
    found = f"found in {samples:,} steps"
    value = measured(term.coefficient, term.error)
    if "+/-" not in value:
        return found
    return f"{found}: {value}{' per unit of time' if rate else ''}"


def evidence_of_outcomes(finding: StochasticEffect) -> list[str]:
    """Return the observed outcomes of an action, for comments above it, a line each."""
    lines = [f"Observed in {finding.samples:,} steps; the effects are as written:"]
    for outcome in finding.outcomes:
        if outcome.probability < 0.005 and not outcome.written:
            continue
        what = " and ".join(f"({name}) {by:+g}" for name, by in outcome.changes)
        share = f"{100 * outcome.probability:.0f} +/- {max(1.0, 100 * outcome.error):.0f} %"
        written = ", as written" if outcome.written else ""
        lines.append(f"  {share}: {what or 'nothing changes'}{written}")
    return lines


def evidence_of_rule(finding: RuleFinding) -> str:
    """Return the observations of a line on rewards or ends, for a comment above it."""
    what = f"Observed in {finding.samples:,} steps: predicted in {finding.predicted:,}"
    if finding.fluent == END:
        came = f"the task ended in {finding.came:,} of them"
    else:
        came = f"reward {finding.expected:.3g} on average, observed {finding.observed:.3g}"
    more = f"; applied in {finding.unpredicted:,} others" if finding.unpredicted else ""
    return f"{what}, {came}{more}." if finding.predicted else f"{what}{more}."


def comment(text: str, indent: str, newline: str) -> str:
    """Return comment lines, each with the indent and a line break at its end."""
    width = max(40, _WIDTH - len(indent) - 2)
    plain = text.translate(_PLAIN)
    lines = textwrap.wrap(plain, width, break_long_words=False, break_on_hyphens=False)
    return "".join(f"{indent}; {line}{newline}" for line in lines)
