from __future__ import annotations

from dataclasses import replace

import numpy as np

from serp.model.learned.regression_data import predictions
from serp.model.transition_model import TransitionModel
from tests.serp.model.learned.rolls import from_text
from tests.serp.runs.diagnosis.made_up import chances, found, predictions_with, states_of


def test_outcomes_count_as_their_mean(model: TransitionModel) -> None:
    states, actions = states_of(model, 60)
    findings = found(
        chances(model, "drive", ({"place ?r": 1.5}, 0.5, True), ({"place ?r": -1.0}, 0.25, False))
    )
    truth = predictions(model, states, actions)
    names = [action.name for action in model.actions]
    columns = {fluent.name: fluent.index for fluent in model.fluents}
    for robot in ("r1", "r2"):
        rows = actions == names.index(f"drive {robot}")
        truth[rows, columns[f"place {robot}"]] = states[rows, columns[f"place {robot}"]] + 0.5
    np.testing.assert_allclose(predictions_with(model, findings, states, actions), truth)


def test_a_name_that_could_be_several_fluents_is_left_alone(model: TransitionModel) -> None:
    states, actions = states_of(model, 20)
    findings = found(chances(model, "drive", ({"place": 9.0}, 1.0, False)))
    with_it = predictions_with(model, findings, states, actions)
    np.testing.assert_array_equal(with_it, predictions(model, states, actions))
    findings = found(chances(model, "drive", ({"warmth": 9.0}, 1.0, False)))
    assert (predictions_with(model, findings, states, actions) != with_it).any()


GRID = """(define (domain grid)
  (:requirements :conditional-effects :numeric-fluents)
  (:functions (row) (column))
  (:action down :parameters () :precondition (and)
    :effect (and (when (< (row) 3) (increase (row) 1))))
  (:action left :parameters () :precondition (and)
    :effect (and (when (> (column) 0) (decrease (column) 1)))))
"""


def test_what_happens_instead_stops_at_walls_as_the_action_that_does_it() -> None:
    model = from_text(GRID).model
    rng = np.random.default_rng(0)
    states = rng.integers(0, 4, size=(200, 2)).astype(np.float64)
    finding = chances(model, "down", ({"row": 1.0}, 0.5, True), ({"column": -1.0}, 0.5, False))
    own, other = finding.outcomes
    findings = found(replace(finding, outcomes=(own, replace(other, like="left"))))
    actions = np.zeros(len(states), np.int64)
    truth = (model.step(states, 0).state + model.step(states, 1).state) / 2
    np.testing.assert_allclose(predictions_with(model, findings, states, actions), truth)
