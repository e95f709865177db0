"""Conditions that exclude each other hold together in no state."""

from __future__ import annotations

import pytest
from hypothesis import given

from serp.authoring.lint.conditions import contradiction
from serp.model.flags import APPLICABLE
from serp.model.transition_model import Vector
from tests.generated.models import Generated, load_texts, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import Texts


@given(models_with_states(count=4))
@examples(150)
def test_an_action_whose_conditions_exclude_each_other_is_applicable_nowhere(
    drawn: tuple[Generated, Vector],
) -> None:
    generated, states = drawn
    model = generated.model
    theta = model.theta.tolist()
    for index, action in enumerate(model.actions):
        if contradiction(action.preconditions, theta):
            for state in states.tolist():
                assert not model.transition(state, index)[1] & APPLICABLE


@pytest.mark.parametrize(
    ("condition", "never"),
    [
        ("(> (atan2 (x) (y)) 90)", True),  # degrees
        ("(< (* 2 (abs (x))) -1)", True),
        ("(= (+ (sin (x)) 1) 2.5)", True),
        ("(not (>= (sqrt (x)) 0))", True),
        ("(> (max 1 (- 7 (abs -2))) (- (+ (x) 4) (x)))", False),
        ("(< (max 1 (- 7 (abs -2))) (- (+ (x) 4) (x)))", True),
        ("(> (cos (x)) -1)", False),
        ("(not (= (sqrt (x)) -1))", False),
    ],
)
def test_what_a_function_never_gives_is_known(condition: str, never: bool) -> None:
    text = f"""(define (domain d) (:requirements :math-functions) (:functions (x) (y))
      (:action a :precondition {condition}))"""
    model = load_texts(Texts(text, None)).model
    tests = model.ground.actions[0].preconditions
    assert (contradiction(tests, model.theta.tolist()) is not None) == never
