from __future__ import annotations

import numpy as np
import pytest

from serp.adaptation.forecast_skill import ForecastSkill, update_means
from serp.model.transition_model import Vector
from tests.serp.adaptation.worlds import plus


def observe(skill: ForecastSkill, state: Vector, predicted: Vector, observed: Vector) -> None:
    skill.steps += update_means(state, predicted, observed, skill.steps, skill.means)


def told(skill: ForecastSkill, steps: int, *shares: float) -> bool:
    """Whether it is reliable after steps of which such a share of each fluent is predicted."""
    rng = np.random.default_rng(0)
    for _ in range(steps):
        state, change = rng.normal(size=(2, 2))
        observe(skill, state, state + np.array(shares) * change, state + change)
    return skill.reliable


@pytest.mark.parametrize("predicted, reliable", [(0.0, True), (1.0, False)])
def test_what_never_changed_is_predicted_unless_it_was_said_to_change(
    predicted: float, reliable: bool
) -> None:
    skill = ForecastSkill(2)
    for k in range(50):
        state = np.array([0.0, float(k)])
        observe(skill, state, plus(state, predicted, 1.0), plus(state, 0.0, 1.0))
    assert skill.reliable == reliable


@pytest.mark.parametrize(
    "shares, reliable",
    [((1.0, 1.0), True), ((0.7, 0.7), True), ((0.66, 0.66), False), ((1.0, 0.0), False)],
)
def test_reliable_is_who_lately_foresees_nine_tenths_of_the_squared_change_of_every_fluent(
    shares: tuple[float, float], reliable: bool
) -> None:
    assert told(ForecastSkill(2), 100, *shares) == reliable
    assert not told(ForecastSkill(2), 10, *shares)  # too few to say
    skill = ForecastSkill(2)
    for share in (1.0, 0.0):
        told(skill, 1000, share, share)
        assert skill.reliable == bool(share)
    assert told(skill, 1000, *shares) == reliable


@pytest.mark.parametrize("worth", [np.nan, np.inf, -np.inf, 1e308])
def test_what_is_no_number_is_left_out(worth: float) -> None:
    clean, spoilt = ForecastSkill(2), ForecastSkill(2)
    for skill in (clean, spoilt):
        told(skill, 50, 0.9, 0.9)
    good, bad = np.array([1.0, 2.0]), np.array([1.0, worth])
    for steps in ((good, good, bad), (good, bad, good), (bad, good, good), (bad, good, bad)):
        observe(spoilt, *steps)
    assert clean.steps == spoilt.steps
    assert clean.means.tobytes() == spoilt.means.tobytes()


def test_one_surprise_is_forgotten() -> None:
    """A fluent that rests, and once did what nobody foresaw, does not tell against all others."""
    skill = ForecastSkill(2)
    for step in range(3_000):
        state = np.array([float(step), 0.0])
        moved = np.array([step + 1.0, 5.0 if step == 40 else 0.0])
        observe(skill, state, np.array([step + 1.0, 0.0]), moved)
        assert step != 41 or not skill.reliable
    assert skill.reliable
