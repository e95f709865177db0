"""States and actions from outside: what fits is taken, what does not is refused with its name."""

import numpy as np
import pytest

from serp.model.transition_model import StateError
from tests.generated import Texts, load_texts


@pytest.fixture(scope="module")
def small():
    texts = Texts(
        "(define (domain d) (:predicates (lit)) (:functions (heat) (cost))"
        " (:action on :parameters () :precondition (and (not (lit))) :effect (and (lit)))"
        " (:action warm :parameters () :precondition (and) :effect (and (increase (heat) 0.5))))",
        "(define (problem p) (:domain d) (:init (= (cost) 2)))",
    )
    return load_texts(texts).model


def test_states_by_name_and_actions_by_name_or_position(small):
    state = small.state({"heat": 1.5, "lit": True})
    assert state.tolist() == [1.0, 1.5]
    assert small.values(state) == {"lit": True, "heat": 1.5}
    for action in ("warm", "(warm)", "WARM", 1, np.int64(1)):
        small.step(state, action).state[0] = 7.0
        assert small.step(state, action).state.tolist() == [1.0, 2.0]
    assert state.tolist() == [1.0, 1.5]  # a step leaves its argument alone


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"heat": 1.0}, "no value for fluent `lit`; values are given for `heat`"),
        ({"heat": 1.0, "lit": True, "het": 2.0}, "did you mean `heat`"),
        ({"heat": 1.0, "lit": True, "cost": 2.0}, "`cost` is fixed, because `:init` gives"),
        ({"heat": 1.0, "lit": 0.5}, "`lit` must be 0 or 1, not 0.5"),
    ],
)
def test_values_that_do_not_fit_are_refused(small, values, says):
    with pytest.raises(StateError, match=says):
        small.state(values)


@pytest.mark.parametrize(
    ("state", "says"),
    [
        (np.zeros(1), "2 numbers .* found 1: none for `heat`"),
        (np.zeros(3), "found 3: 1 more than the fl"),
    ],
)
def test_arrays_that_are_no_states_are_refused(small, state, says):
    for use in (small.check_state, lambda state: small.step(state, 0)):
        with pytest.raises(StateError, match=says):
            use(state)


@pytest.mark.parametrize(
    ("states", "action", "says"),
    [
        (np.zeros(2), "warn", "did you mean `warm`"),
        (np.zeros(2), 2, "action 2"),
        (np.zeros((2, 2)), [0, 2], "positions of actions must be from 0 to 1"),
        (np.zeros((2, 2)), [0, 1, 0], "2 positions"),
        (np.zeros((2, 3)), 0, "found 3 columns"),
        (np.full(2, np.nan), 0, "must not contain NaN or infinity"),
    ],
)
def test_steps_that_do_not_fit_are_refused(small, states, action, says):
    with pytest.raises(StateError, match=says):
        small.step(states, action)


@pytest.mark.parametrize(
    ("change", "says"), [({"theta": []}, "theta must be 1 finite"), ({"dt": 0.0}, "control period")]
)
def test_parameters_and_periods_that_do_not_fit_are_refused(small, change, says):
    with pytest.raises(StateError, match=says):
        small.replace(**change)
