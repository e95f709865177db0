"""Explanations quote the line that is to blame, with the values it reads."""

from __future__ import annotations

import re
from random import Random

from serp.model.explanation import why_not_applicable, why_unsafe
from serp.model.transition_model import TransitionModel
from tests.generated import PLANNABLE, Texts, generate, load_texts, random_states
from tests.serp.planning.worlds import WORLDS, states_of, world

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


def lab(**values: float | bool) -> tuple[TransitionModel, dict[str, float | bool]]:
    model = load_texts(Texts(TEXT, None)).model
    usual: dict[str, float | bool] = {f.name: 0.0 if f.numeric else False for f in model.fluents}
    return model, {**usual, **values}


def not_applicable(action: str, **values: float | bool) -> str:
    model, state = lab(**values)
    return why_not_applicable(model, model.state(state), model.action_index(action))


def unsafe(action: str, **values: float | bool) -> str:
    model, state = lab(**values)
    return why_unsafe(model, model.state(state), model.action_index(action))


def test_a_failed_precondition_comes_with_the_values_that_it_reads() -> None:
    assert (
        not_applicable("drive hall") == "drive hall: `(open)` (line 8) does not hold (open = false)"
    )
    assert not_applicable("drive hall", open=True, battery=0.125) == (
        "drive hall: `(>= (battery) 0.25)` (line 9) does not hold (battery = 0.125)"
    )
    model, state = lab(open=True, battery=1.0)
    state["at hall"] = True
    assert why_not_applicable(model, model.state(state), model.action_index("drive hall")) == (
        "drive hall: `(not (at ?to))` (line 10) does not hold (at hall = true)"
    )


def test_a_failed_disjunction_shows_all_of_its_values() -> None:
    assert not_applicable("lift", load=1.5) == (
        "lift: `(or (open) (< (load) 1))` (line 14) does not hold (open = false, load = 1.5)"
    )


def test_a_precondition_that_reads_nothing_shows_no_values() -> None:
    assert not_applicable("never") == "never: `(> 1 2)` (line 31) does not hold"


def test_effects_that_contradict_each_other_are_quoted() -> None:
    assert re.fullmatch(
        r"both: `.+` \(line 24\) contradicts another effect", not_applicable("both", open=True)
    )


def test_a_result_that_is_no_number_is_named() -> None:
    assert not_applicable("split") == "split: split gives no finite number"


def test_an_applicable_action_is_said_to_be_one() -> None:
    assert not_applicable("lift") == "lift is applicable"


def test_the_effect_that_is_unsafe_is_quoted() -> None:
    assert unsafe("lift", open=True, load=3.0) == "lift: `(unsafe)` (line 16)"


def test_an_event_that_is_unsafe_is_named() -> None:
    assert unsafe("drive hall", open=True, battery=0.25) == (
        "drive hall: `(unsafe)` (line 36) through event empty"
    )


def test_what_is_not_unsafe_is_said_not_to_be() -> None:
    assert unsafe("calm") == "calm is not predicted unsafe"
    assert unsafe("lift", open=True, load=2.0) == "lift is not predicted unsafe"


def test_explanations_agree_with_predictions_on_generated_domains() -> None:
    """Every refusal has an explanation, nothing else has one, and none fails."""
    explained = {"unsafe": 0, "not applicable": 0}
    models = [(world(seed), states_of(world(seed), Random(seed), 6)) for seed in range(WORLDS)]
    for seed in range(60):
        random = Random(seed)
        model = generate(random, PLANNABLE).model
        models.append((model, random_states(random, model, 6)))
    for model, states in models:
        for state in states:
            for action in range(len(model.actions)):
                outcome = model.step(state, action)
                why_not = why_not_applicable(model, state, action)
                assert why_not.endswith("is applicable") == outcome.applicable
                explained["not applicable"] += not outcome.applicable
                if outcome.applicable:
                    why = why_unsafe(model, state, action)
                    assert why.endswith("not predicted unsafe") == (not outcome.unsafe)
                    explained["unsafe"] += outcome.unsafe
    assert min(explained.values()) > 200
