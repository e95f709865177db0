"""What a model says of its learned parts is what it predicts with."""

import json
import re

import numpy as np
import pytest

from serp.model.learned.adoption import ModelAdoption, Reliability, WorthAdoption
from serp.ui.commands import diagnosis
from tests.serp.model.learned.worlds import GRID, PLANE, adaptation


def plane(steps, push, seed=0):
    """A model after steps of a mass that a push accelerates, of which the file knows nothing."""
    of = adaptation(PLANE)
    rng, state = np.random.default_rng(seed), np.zeros(2)
    for _ in range(steps):
        action = int(rng.integers(2))
        after = np.array([state[0] + 0.1 * state[1], 0.99 * state[1] + push * (action == 0)])
        of.observe(state, action, after, False)
        state = after if abs(after[0]) < 3 else rng.normal(size=2)
    return of


def test_each_fluent_says_whether_it_is_adapted_and_why():
    of = plane(200, 0.3)
    adoption = of.adoption
    position, speed = adoption.fluents
    assert (position.fluent, speed.fluent) == ("p", "v")
    assert not position.adapted and "the file was right in 200 steps" in position.why
    assert set(speed.residual) == {"push", "rest"} and "% of the file's" in speed.why
    assert adoption.in_use
    assert str(adoption) == "adapted: residual for `v`; unchanged from the file: `p`"
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


def test_counted_outcomes_are_named():
    of = adaptation(GRID)
    names = [fluent.name for fluent in of.model.fluents]
    rng, right = np.random.default_rng(0), 0
    state = np.zeros(len(names))
    for _ in range(80):
        expected = np.array(of.model.replace().transition(state.tolist(), right)[0][:-1])
        after = expected if rng.random() < 0.5 else state
        of.observe(state, right, after, False)
        state = np.clip(after, -3, 3)
    assert any(fluent.outcomes for fluent in of.adoption.fluents)


def test_a_model_that_does_not_adapt_says_so():
    of = adaptation(PLANE, mode="off")
    assert not of.adoption.adapts and not of.adoption.in_use and not of.adoption.fluents
    assert str(of.adoption) == "as written; nothing is learned"


def test_corrections_of_reward_and_end_are_printed_with_their_errors(capsys):
    bins = (Reliability(90, 0.01, 0.0), Reliability(10, 0.5, 0.4))
    worth = (
        WorthAdoption("reward", True, 100, 4.0, 0.25, ()),
        WorthAdoption("terminal", True, 100, 0.3, 0.04, bins),
    )
    diagnosis._print_worth(worth)
    printed = capsys.readouterr().out
    for row in (("square error", "2", "0.5"), ("Brier score", "0.3", "0.04")):
        assert re.search(r" +".join(map(re.escape, row)), printed), printed
    diagnosis._print_worth(tuple(each._replace(corrected=False) for each in worth))
    assert capsys.readouterr().out == ""
    in_use = ModelAdoption(adapts=True, worth=worth)
    assert in_use.in_use and in_use.as_dict()["worth"][1]["reliability"][1]["ended"] == 0.4
    assert str(in_use) == "adapted: correction for `(reward)`, `(terminal)`"
