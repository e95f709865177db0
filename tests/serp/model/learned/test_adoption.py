"""What a model says of its learned parts is what it predicts with."""

import json

import numpy as np
import pytest

from serp.model.learned.transitions import GOES_ON
from tests.serp.model.learned.worlds import PLANE, adaptation


def plane(steps, push, seed=0):
    """A model after steps of a mass that a push accelerates, of which the file knows nothing."""
    of = adaptation(PLANE)
    rng, state = np.random.default_rng(seed), np.zeros(2)
    for _ in range(steps):
        action = int(rng.integers(2))
        after = np.array([state[0] + 0.1 * state[1], 0.99 * state[1] + push * (action == 0)])
        of.observe(state, action, after, GOES_ON)
        state = after if abs(after[0]) < 3 else rng.normal(size=2)
    return of


def test_each_fluent_says_whether_it_is_adapted_and_why():
    of = plane(200, 0.3)
    adoption = of.adoption
    position, speed = adoption.fluents
    assert (position.fluent, speed.fluent) == ("p", "v")
    assert not position.adapted and "the file was right in 200 steps" in position.why
    assert set(speed.residual) == {"push", "rest"} and "% of that of the file" in speed.why
    assert adoption.in_use
    assert str(adoption) == "adapted: residual for `v`; as written: `p`"
    said = json.dumps(adoption.as_dict(), allow_nan=False)
    assert json.loads(said)["fluents"][1]["adapted"] is True


@pytest.mark.parametrize("steps", [0, 1, 200])
def test_nothing_is_said_to_be_in_use_where_the_model_is_as_written(steps):
    of = plane(steps, 0.3)
    state = np.array([0.5, 0.25])
    written = of.model.replace().transition(state.tolist(), 0)[0]
    adapted = of.model.transition(state.tolist(), 0)[0]
    assert of.adoption.in_use is (adapted != written)
    if not of.adoption.in_use:
        assert str(of.adoption).startswith("as written")
