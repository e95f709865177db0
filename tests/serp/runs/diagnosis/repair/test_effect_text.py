"""Numbers, terms and comments as PDDL, and edits of one effect."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.pddl import syntax as x
from serp.pddl.source import edited
from serp.runs.diagnosis.findings import EffectTerm
from serp.runs.diagnosis.repair import EffectEdit, comment, decimal, effect_of, plus
from tests.serp.model.learned.rolls import from_text

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
    ("value", "error", "number"),
    [
        (0.2134, 0.02, "0.21"),
        (0.2, 0.01, "0.20"),
        (-0.105, 0.0096, "-0.105"),
        (15.7734, 0.0005, "15.77"),
        (1.0, 1e-9, "1"),
        (-0.00390256, 5e-10, "-0.003903"),
        (1234.0, 20.0, "1230"),
        (0.0, 0.1, "0"),
    ],
)
def test_a_number_ends_where_it_is_uncertain(value: float, error: float, number: str) -> None:
    assert decimal(value, error) == number


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


def test_comments_stay_comments() -> None:
    text = comment("word " * 60, "    ", "\r\n")
    lines = text.split("\r\n")
    assert lines.pop() == ""
    assert all(line.startswith("    ; word") and len(line) <= 100 for line in lines)
    assert len(lines) > 2


# One effect --------------------------------------------------------------------------------------


def edit_of(effect: str) -> EffectEdit:
    text = f"""(define (domain d) (:functions (f) (g))
      (:action a :parameters () :precondition (and) :effect {effect}))"""
    (schema,) = from_text(text).syntax.schemas
    (found,) = schema.effects
    assert isinstance(found, x.ChangeFunction)
    return EffectEdit(schema.name, found)


def text_of(edit: EffectEdit) -> str:
    place = edit.effect.place
    old = place.source.text
    new = edited(old, edit.edits())
    return " ".join(new[place.start : len(new) - len(old) + place.end].split())


def numbers(value: x.Expression) -> list[x.Number]:
    if isinstance(value, x.Number):
        return [value]
    return [n for v in getattr(value, "operands", ()) for n in numbers(v)]


def with_numbers(effect: str, *new: str) -> str:
    found = edit_of(effect)
    for number, text in zip(numbers(found.effect.value), new, strict=True):
        found.set_number(number.place, text)
    return text_of(found)


@pytest.mark.parametrize(
    ("effect", "new", "text"),
    [
        ("(increase (f) 1)", ["0.5"], "(increase (f) 0.5)"),
        ("(increase (f) 1)", ["-0.5"], "(decrease (f) 0.5)"),
        ("(Decrease (f) 1)", ["-0.5"], "(increase (f) 0.5)"),
        ("(decrease (f) -1)", ["0.5"], "(decrease (f) 0.5)"),
        ("(increase (f) (* 2 (* (g) 3)))", ["-4", "-5"], "(increase (f) (* 4 (* (g) 5)))"),
        ("(increase (f) (/ (g) 3))", ["-5"], "(decrease (f) (/ (g) 5))"),
        ("(increase (f) (+ (g) 3))", ["-5"], "(increase (f) (+ (g) -5))"),
        ("(assign (f) 3)", ["-5"], "(assign (f) -5)"),
        ("(scale-up (f) 3)", ["-5"], "(scale-up (f) -5)"),
        ("(increase (f) 1)", ["1"], "(increase (f) 1)"),
    ],
)
def test_signs_go_into_the_word_where_that_says_the_same(
    effect: str, new: list[str], text: str
) -> None:
    assert with_numbers(effect, *new) == text
