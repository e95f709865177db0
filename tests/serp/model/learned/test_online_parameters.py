"""The parameters of a file, estimated anew while a run goes on."""

import numpy as np
import pytest

from serp.model.learned.parameter_fit import ParameterEstimation
from serp.model.learned.transitions import TransitionMemory
from tests.serp.model.learned.rolls import from_text

WALK = """(define (domain walk)
  (:functions (near) (far))
  (:action step :parameters () :precondition (and)
    :effect (and (decrease (near) 0.4) (increase (far) 0.2))))
"""


def observed(steps, change):
    """Steps from random states that change the fluents of `WALK` so."""
    rng = np.random.default_rng(5)
    experience = TransitionMemory(steps, 2, 9)
    for k in range(steps):
        state = rng.normal(size=2)
        experience.add(state, 0, state + change(k), False)
    return experience


def adopted(experience, text=WALK):
    """The parameters after these steps."""
    model = from_text(text).model
    return ParameterEstimation(model).reconsider(experience, model.theta.copy())


@pytest.mark.parametrize("truth", [-0.01, -0.2, -1.0, 0.3])
def test_what_always_happens_is_believed_however_little_or_contrary(truth):
    near, far = adopted(observed(64, lambda _: (truth, 0.2)))
    assert near == pytest.approx(-truth, abs=1e-3)
    assert far == pytest.approx(0.2)


def test_an_effect_that_seldom_comes_about_is_not_averaged_away():
    rng = np.random.default_rng(3)
    near, _ = adopted(observed(256, lambda _: (-0.4 * (rng.random() < 0.1), 0.2)))
    assert near == pytest.approx(0.1)  # a quarter of what is written; the mean is 0.04


@pytest.mark.parametrize("reading", [10.0, 1e3, 1e160, np.inf, np.nan])
@pytest.mark.parametrize("at", [20, 100, 200, 255])
def test_a_outlier_neither_blocks_an_estimate_nor_lets_one_pass(reading, at):
    """Of its own step it says nothing true, and of the one that begins with it neither."""
    for truth, expected in ((1.0, 0.2), (0.1, 0.1)):
        rng = np.random.default_rng(3)

        def change(k, truth=truth, rng=rng):
            much = 0.2 if truth == 1.0 else 0.4 * (rng.random() < truth)
            return reading if k == at else -much + 0.02 * rng.standard_normal(), 0.2

        near, _ = adopted(observed(256, change))
        assert near == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("truth", [0.2, -0.2])
def test_what_is_written_as_nothing_may_be_estimated_either_way(truth):
    rng = np.random.default_rng(0)
    experience = observed(256, lambda _: (truth + 0.3 * rng.standard_normal(), 0.2))
    near, _ = adopted(experience, WALK.replace("(near) 0.4", "(near) 0.0"))
    assert near == pytest.approx(-truth, abs=0.1)


def test_a_range_too_large_to_calculate_with_does_no_harm():
    """One object is where the numbers end, and the other one moves by little."""
    text = """(define (domain apart) (:constants there here) (:functions (at ?x) (speed))
      (:action step :parameters () :effect (increase (at here) (* 0.4 (speed)))))"""
    rng = np.random.default_rng(5)
    experience = TransitionMemory(64, 3, 9)
    for _ in range(64):
        state, change = rng.normal(size=(2, 3)) * (1e307, 1.0, 1e-3)
        experience.add(state, 0, state + change, False)
    with np.errstate(all="ignore"):
        assert adopted(experience, text).tolist() == [0.4]
