"""A game is the file's world, with what each step changed and why, and can be taken back."""

import numpy as np
import pytest

from serp.authoring.play import Game
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.pddl.source import Source
from serp.tasks.file_world import WorldOptions, starting
from tests.worlds import text

VAN = text("van")
ROADS = """(define (problem p) (:domain van) (:objects yard shop field - place) ; three
  (:init (at yard) (road yard shop) (road shop yard) (= (fuel) 8)) (:goal (at field)))"""


def van(problem=ROADS):
    given = None if problem is None else Source("van-problem.pddl", problem)
    return Domain.parse(Source("van.pddl", VAN), given)


def drive(game, where):
    return game.model.action_index(f"drive {where}")


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_every_change_has_its_causes_in_the_file(noise):
    game = Game(van(), WorldOptions(noise=noise), seed=4)
    while not game.moment.over:
        before = game.values
        steps = [k for k in range(len(game.model.actions)) if not game.refusal(k)]
        played = game.step(steps[0])
        changed = {change.name for change in played.changes}
        assert changed == {name for name, old in before.items() if old != game.values[name]}
        for change in played.changes:
            sum_of = sum(cause.amount or 0.0 for cause in change.causes) + change.noise
            assert change.before + sum_of == pytest.approx(float(change.after))
            assert (change.noise != 0.0) == (noise > 0.0 and change.name == "fuel")
        gained = [cause.amount for cause in played.brought if cause.what == "reward"]
        assert sum(amount or 0.0 for amount in gained) == pytest.approx(played.reward)
    last = {(c.what, c.origin, c.name, c.comment) for c in played.brought}
    assert ("unsafe", "event", "empty", "nobody comes") in last
    assert played.changes[0].causes[0].comment == "along a road"
    with pytest.raises(SerpError, match="the episode is over; restart, or undo"):
        game.step(0)


def test_fluents_are_changed_and_facts_that_nothing_changes_are_given_at_the_start():
    game = Game(van())
    assert "at field" not in game.values  # no road leads there
    game.step(drive(game, "yard shop"))
    game.set({"fuel": 20})
    assert (game.moment.steps, game.values["at shop"], game.values["fuel"]) == (1, True, 20.0)
    assert game.undo() and game.values["fuel"] == 5.0
    with pytest.raises(SerpError, match="`road shop field` is fixed by the problem"):
        game.set({"road shop field": True})
    game = Game(starting(van(), {"road yard field": True}))
    game.step(drive(game, "yard field"))
    assert game.moment.over


def test_a_start_is_written_into_the_problem_and_all_else_is_left_as_it_is():
    changed = starting(van(), {"fuel": 0.1, "at yard": False, "at shop": True})
    text = changed.problem_source.text
    assert text.startswith(ROADS[: ROADS.index("(:init")]) and text.endswith("(:goal (at field)))")
    assert "(= (fuel) 0.1)" in text and "(at yard)" not in text and "(road yard shop)" in text
    tank = Source("tank.pddl", "(define (domain tank) (:functions (a) (b))"
                  " (:action fill :precondition (< (b) 1) :effect (increase (a) 1)))")  # fmt: skip
    game = Game(Domain.parse(tank))
    assert game.values == {"a": 0.0, "b": 0.0}
    begun = starting(Domain.parse(tank), {"a": -1e-7})
    assert begun.closed().model.initial_state is not None
    np.testing.assert_array_equal(begun.closed().model.initial_state, [-1e-7, 0.0])
