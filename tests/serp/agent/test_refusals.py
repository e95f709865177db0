"""Explanations quote the line that is to blame, with the values it reads."""

from __future__ import annotations

import pytest

from serp.agent.refusals import why_not_applicable, why_unsafe
from serp.model.transition_model import TransitionModel, Vector
from tests.generated import Texts, load_texts

TEXT = """(define (domain lab)
  (:requirements :typing :fluents)
  (:constants kitchen hall)
  (:predicates (at ?room) (open) (unsafe) (terminal))
  (:functions (battery) (load) (reward))
  (:action drive
    :parameters (?to)
    :precondition (and (open)
      (>= (battery) 0.25)
      (not (at ?to)))
    :effect (and (at ?to) (decrease (battery) 0.5)))
  (:action lift
    :parameters ()
    :precondition (and (or (open) (< (load) 1)) (not (unsafe)) (> 2 1))
    :effect (and (increase (load) 1)
      (when (> (load) 2) (unsafe))))
  (:action calm
    :parameters ()
    :precondition (and)
    :effect (and (decrease (load) 4)))
  (:action both
    :parameters ()
    :precondition (and)
    :effect (and (when (open) (assign (load) 1)) (when (open) (increase (load) 2))))
  (:action split
    :parameters ()
    :precondition (and)
    :effect (and (assign (load) (/ 1 (battery)))))
  (:action never
    :parameters ()
    :precondition (and (> 1 2))
    :effect (and (open)))
  (:event empty
    :parameters ()
    :precondition (and (< (battery) 0))
    :effect (and (unsafe))))
"""


@pytest.fixture(scope="module")
def lab() -> TransitionModel:
    return load_texts(Texts(TEXT, None)).model


def state_of(model: TransitionModel, given: dict[str, float]) -> Vector:
    return model.state({f.name: given.get(f.name, 0.0) for f in model.fluents})


@pytest.mark.parametrize(
    ("action", "given", "says"),
    [
        ("drive hall", {}, "`(open)` (line 8) does not hold (open = false)"),
        (
            "drive hall",
            {"open": 1, "battery": 0.125},
            "`(>= (battery) 0.25)` (line 9) does not hold (battery = 0.125)",
        ),
        (
            "lift",
            {"load": 1.5},
            "`(or (open) (< (load) 1))` (line 14) does not hold (open = false, load = 1.5)",
        ),
        ("never", {}, "`(> 1 2)` (line 31) does not hold"),
        ("both", {"open": 1}, "`(increase (load) 2)` (line 24) contradicts another effect"),
        ("split", {}, "split gives no finite number"),
    ],
)
def test_what_keeps_an_action_from_being_applicable_is_quoted(
    lab: TransitionModel, action: str, given: dict[str, float], says: str
) -> None:
    index = lab.action_index(action)
    assert why_not_applicable(lab, state_of(lab, given), index) == f"{action}: {says}"


@pytest.mark.parametrize(
    ("action", "given", "says"),
    [
        ("lift", {"open": 1, "load": 3}, "lift: `(unsafe)` (line 16)"),
        (
            "drive hall",
            {"open": 1, "battery": 0.25},
            "drive hall: `(unsafe)` (line 36) through event empty",
        ),
        ("calm", {}, "calm is not predicted unsafe"),
        ("lift", {"open": 1, "load": 2}, "lift is not predicted unsafe"),
    ],
)
def test_the_effect_or_event_that_is_unsafe_is_quoted(
    lab: TransitionModel, action: str, given: dict[str, float], says: str
) -> None:
    index, state = lab.action_index(action), state_of(lab, given)
    assert why_unsafe(lab, state, index) == says
    assert why_not_applicable(lab, state, index) == f"{action} is applicable"
