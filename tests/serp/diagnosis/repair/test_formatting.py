"""Numbers, terms and evidence as PDDL."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.diagnosis.findings import EffectTerm
from serp.diagnosis.repair.formatting import (
    comment,
    decimal,
    effect_of,
    evidence_of_term,
    measured,
    plus,
)

SIZES = st.floats(1e-6, 1e6).flatmap(lambda x: st.sampled_from([x, -x]))


@given(SIZES, st.floats(0.0, 0.3))
def test_a_number_is_a_plain_decimal_within_its_error(value: float, share: float) -> None:
    error = share * abs(value)
    text = decimal(value, error)
    assert re.fullmatch(r"-?\d+(\.\d+)?", text)
    assert abs(float(text) - value) <= max(error, 5.001e-4 * abs(value))
    assert (float(text) < 0) == (value < 0)
    assert len(text.strip("-0.").replace(".", "")) <= max(4, math.log10(abs(value)) + 1.001)


@pytest.mark.parametrize(
    ("value", "error", "number", "with_error"),
    [
        (0.2134, 0.02, "0.21", "0.21 +/- 0.02"),
        (0.2, 0.01, "0.20", "0.20 +/- 0.01"),
        (-0.105, 0.0096, "-0.105", "-0.105 +/- 0.010"),
        (15.7734, 0.0005, "15.77", "15.77"),
        (0.1003, 8e-5, "0.1003", "0.1003 +/- 0.0001"),
        (1.0, 1e-9, "1", "1"),
        (-0.00390256, 5e-10, "-0.003903", "-0.003903"),
        (1234.0, 20.0, "1230", "1230 +/- 20"),
        (0.0, 0.1, "0", None),
    ],
)
def test_it_ends_where_it_is_uncertain_and_an_error_is_told_where_it_shows(
    value: float, error: float, number: str, with_error: str | None
) -> None:
    assert decimal(value, error) == number
    assert with_error is None or measured(value, error) == with_error


def test_effects_are_binary_and_have_no_sign() -> None:
    assert effect_of("f ?x", EffectTerm(-0.5, 0.01, ("a",)), rate=False) == (
        "(decrease (f ?x) (* 0.50 (a)))"
    )
    assert effect_of("f", EffectTerm(1.0, 1e-6, ("b ?x", "c")), rate=True) == (
        "(increase (f) (* #t (* (b ?x) (c))))"
    )
    assert effect_of("f", EffectTerm(2.0, 0.1, ()), rate=True) == "(increase (f) (* #t 2.0))"
    terms = [EffectTerm(-0.5, 0.01, ("a",)), EffectTerm(0.2, 0.01, ())]
    assert plus("(b)", terms) == "(+ (- (b) (* 0.50 (a))) 0.20)"


def test_evidence_says_what_the_effect_does_not() -> None:
    certain, uncertain = EffectTerm(0.5, 1e-9, ("a",)), EffectTerm(-0.5, 0.02, ("a",))
    assert evidence_of_term(certain, 1234, rate=True) == "found in 1,234 steps"
    assert evidence_of_term(uncertain, 12, rate=False) == "found in 12 steps: -0.50 +/- 0.02"
    assert evidence_of_term(uncertain, 12, rate=True).endswith("0.02 per unit of time")


def test_comments_stay_comments() -> None:
    text = comment("word " * 60, "    ", "\r\n")
    lines = text.split("\r\n")
    assert lines.pop() == ""
    assert all(line.startswith("    ; word") and len(line) <= 100 for line in lines)
    assert len(lines) > 2
