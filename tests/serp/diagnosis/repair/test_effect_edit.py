"""Edits of one effect."""

from __future__ import annotations

import pytest

from serp.diagnosis.findings import EffectTerm
from serp.diagnosis.repair.effect_edit import EffectEdit
from serp.pddl import syntax as x
from tests.serp.sysid.rolls import from_text


def edit_of(effect: str) -> EffectEdit:
    text = f"""(define (domain d) (:functions (f) (g))
      (:action a :parameters () :precondition (and) :effect {effect}))"""
    (schema,) = from_text(text).syntax.schemas
    (found,) = schema.effects
    assert isinstance(found, x.ChangeFunction)
    return EffectEdit(schema, found)


def numbers(value: x.Expression) -> list[x.Number]:
    if isinstance(value, x.Number):
        return [value]
    return [n for v in getattr(value, "operands", ()) for n in numbers(v)]


def with_numbers(effect: str, *new: str) -> str:
    found = edit_of(effect)
    for number, text in zip(numbers(found.effect.value), new, strict=True):
        found.set_number(number.place, text)
    return found.text


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


def test_an_assignment_that_adds_is_an_increase() -> None:
    for effect, text in (
        ("(assign (f) 3)", "(increase (f) 3)"),
        ("(assign (f) -3)", "(decrease (f) 3)"),
        ("(assign (f) (- (g) 3))", "(increase (f) (- (g) 3))"),
    ):
        found = edit_of(effect)
        found.make_increase()
        assert found.text == text
    found = edit_of("(assign (f) 3)")
    found.set_number(numbers(found.effect.value)[0].place, "-2")
    found.make_increase()
    assert found.text == "(decrease (f) 2)"


def test_terms_are_added_to_an_assignment() -> None:
    found = edit_of("(assign (f) 3)")
    found.add_terms([EffectTerm(-0.5, 0.01, ("g",)), EffectTerm(2.0, 1e-9, ())])
    assert found.text == "(assign (f) (+ (- 3 (* 0.50 (g))) 2))"
    found.set_number(numbers(found.effect.value)[0].place, "-4")
    assert found.text == "(assign (f) (+ (- -4 (* 0.50 (g))) 2))"
