"""The shipped cart-pole domain: its physics is about right."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from serp.model.domain import Domain, load_domain

FILE = Path(__file__).parents[3] / "domains" / "cartpole.pddl"
PERIOD = 0.02


@pytest.fixture(scope="module")
def cartpole() -> Domain:
    return load_domain(FILE)


def true_step(state: np.ndarray, force: float) -> np.ndarray:
    """One step of 0.02 s by the equations of motion.

    Barto, Sutton and Anderson (1983) as corrected by Florian (2007), without friction, explicit
    Euler: a cart of 1 kg, a pole of 0.1 kg and 1 m (half of it is 0.5 m), 9.8 m/s².
    """
    _, v, angle, spin = state
    total, half_length, pole_mass = 1.1, 0.5, 0.1
    pushed = (force + pole_mass * half_length * spin**2 * math.sin(angle)) / total
    pole = (9.8 * math.sin(angle) - math.cos(angle) * pushed) / (
        half_length * (4 / 3 - pole_mass * math.cos(angle) ** 2 / total)
    )
    cart = pushed - pole_mass * half_length * pole * math.cos(angle) / total
    return state + PERIOD * np.array([v, cart, spin, pole])


@pytest.mark.parametrize(("action", "force"), [("push-left", -10.0), ("push-right", 10.0)])
def test_the_prediction_is_near_the_true_equations_near_upright(
    cartpole: Domain, action: str, force: float
) -> None:
    model = cartpole.model.replace(dt=PERIOD)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 4)) * [1.0, 0.5, 0.05, 0.5]
    predicted = model.step(states, action).state
    true = np.array([true_step(state, force) for state in states])
    error = np.abs(predicted - true)
    # The push acts before the world moves on, so positions are off by 0.02 s times it.
    assert (error.max(axis=0) < [0.005, 0.005, 0.007, 0.02]).all()
    # Against standing still, the prediction of both velocities is right to a few per cent.
    moved = np.abs(true - states).mean(axis=0)
    assert (error.mean(axis=0)[[1, 3]] < 0.03 * moved[[1, 3]]).all()


@pytest.mark.parametrize(
    "state",
    [(0.0, 0.0, 0.2619, 0.0), (0.0, 0.0, -0.2619, 0.0), (2.41, 0, 0, 0), (-2.41, 0, 0, 0)],
)
def test_falling_and_leaving_the_track_are_unsafe_and_the_end(
    cartpole: Domain, state: tuple[float, ...]
) -> None:
    judged = cartpole.model.judge(np.zeros(4), 0, np.array(state))
    assert judged.unsafe and judged.terminal and judged.reward < 0.0
    inside = np.array(state) * 0.99
    assert cartpole.model.judge(np.zeros(4), 0, inside)[1:] == (False, False)
