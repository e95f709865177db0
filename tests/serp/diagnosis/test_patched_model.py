from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from serp import load_domain
from serp.diagnosis.findings import Findings
from serp.diagnosis.patched_model import forecast_with
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.regression_data import predictions
from tests.serp.diagnosis.made_up import chances, found, missing, parameter, states_of


def next_states(
    model: TransitionModel, findings: Findings, states: Vector, actions: NDArray[np.int64]
) -> Vector:
    return forecast_with(model, findings, states, actions).mean[:, :-2]


def column(model: TransitionModel, name: str) -> int:
    return next(f.index for f in model.fluents if f.name == name)


def rows_of(model: TransitionModel, actions: NDArray[np.int64], action: str) -> NDArray[np.bool_]:
    rows = actions == [a.name for a in model.actions].index(action)
    assert rows.any()
    return rows


def test_parameters_are_replaced_and_nothing_else(model: TransitionModel) -> None:
    states, actions = states_of(model, 50)
    written = predictions(model, states, actions)
    np.testing.assert_array_equal(next_states(model, found(), states, actions), written)
    theta = model.theta.copy()
    theta[0], theta[3] = 2.5, 0.75
    findings = found(parameter(model, 0, 2.5), parameter(model, 3, 0.75))
    truth = predictions(model.replace(theta=theta), states, actions)
    np.testing.assert_array_equal(next_states(model, findings, states, actions), truth)


def test_missing_effects_are_added_to_every_instance(model: TransitionModel) -> None:
    states, actions = states_of(model, 80)
    findings = found(missing(model, "battery ?r", {("warmth", "place ?r"): 0.3, (): -0.1}))
    truth = predictions(model, states, actions)
    warmth = states[:, column(model, "warmth")]
    for robot in ("r1", "r2"):
        rows = rows_of(model, actions, f"drive {robot}")
        place = states[:, column(model, f"place {robot}")]
        truth[rows, column(model, f"battery {robot}")] += (0.3 * warmth * place - 0.1)[rows]
    np.testing.assert_allclose(next_states(model, findings, states, actions), truth)


def test_a_missing_process_goes_on_whatever_the_action(model: TransitionModel) -> None:
    states, actions = states_of(model, 50)
    findings = found(missing(model, "warmth", {(): 0.4}, schema=""))
    truth = predictions(model, states, actions)
    truth[:, column(model, "warmth")] += 0.4 * model.dt
    np.testing.assert_allclose(next_states(model, findings, states, actions), truth)


def test_outcomes_count_as_their_mean(model: TransitionModel) -> None:
    states, actions = states_of(model, 60)
    findings = found(
        chances(model, "drive", ({"place ?r": 1.5}, 0.5, True), ({"place ?r": -1.0}, 0.25, False))
    )
    truth = predictions(model, states, actions)
    for robot in ("r1", "r2"):
        rows = rows_of(model, actions, f"drive {robot}")
        place = column(model, f"place {robot}")
        truth[rows, place] = states[rows, place] + 0.5
    np.testing.assert_allclose(next_states(model, findings, states, actions), truth)


def test_a_name_that_could_be_several_fluents_is_left_alone(model: TransitionModel) -> None:
    states, actions = states_of(model, 20)
    findings = found(chances(model, "drive", ({"place": 9.0}, 1.0, False)))
    with_it = next_states(model, findings, states, actions)
    np.testing.assert_array_equal(with_it, predictions(model, states, actions))
    findings = found(chances(model, "drive", ({"warmth": 9.0}, 1.0, False)))
    assert (next_states(model, findings, states, actions) != with_it).any()


GRID = """(define (domain grid)
  (:requirements :conditional-effects :numeric-fluents)
  (:functions (row) (column))
  (:action down :parameters () :precondition (and)
    :effect (and (when (< (row) 3) (increase (row) 1))))
  (:action left :parameters () :precondition (and)
    :effect (and (when (> (column) 0) (decrease (column) 1)))))
"""


def test_what_happens_instead_stops_at_walls_as_the_action_that_does_it(tmp_path: Path) -> None:
    (tmp_path / "grid.pddl").write_text(GRID, encoding="utf-8")
    model = load_domain(tmp_path / "grid.pddl").model
    rng = np.random.default_rng(0)
    states = rng.integers(0, 4, size=(200, 2)).astype(np.float64)
    findings = found(
        chances(model, "down", ({"row": 1.0}, 0.5, True), ({"column": -1.0}, 0.5, False))
    )
    actions = np.zeros(len(states), np.int64)
    truth = (model.step(states, 0).state + model.step(states, 1).state) / 2
    np.testing.assert_allclose(next_states(model, findings, states, actions), truth)
