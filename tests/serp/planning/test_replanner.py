"""Monitor-replanning on graphs made for it; `test_lookahead` holds it against plain recursion."""

from __future__ import annotations

import time

import pytest

from serp.errors import SettingsError
from serp.model.transition_model import StateError
from serp.planning.edges import Bound
from serp.planning.replanner import MonitorReplanner, Plan
from tests.serp.planning.worlds import load, world

CORRIDOR = """
(define (domain corridor)
  (:predicates (unsafe) (terminal) (locked))
  (:functions (x) (reward))
  (:action left :parameters () :precondition (and (not (locked)))
    :effect (and (decrease (x) 1) (decrease (reward) 1)))
  (:action right :parameters () :precondition (and (not (locked)))
    :effect (and (increase (x) 1) (decrease (reward) 1)))
  (:event pit :parameters () :precondition (and (>= (x) 3)) :effect (and (unsafe)))
  (:event goal :parameters () :precondition (and (<= (x) -3))
    :effect (and (terminal) (increase (reward) 10))))
"""


def corridor(*, locked: bool, depth: int = 5) -> Plan:
    model = load(CORRIDOR)
    return MonitorReplanner(model, depth=depth).plan(model.state({"x": 0, "locked": locked}))


def test_rewards_that_are_all_negative_still_give_an_action() -> None:
    """Where the longest path of the whole graph would be the empty one."""
    decided = corridor(locked=False, depth=2)
    assert decided.action is not None
    assert decided.reward == -1 - 0.99
    assert decided.indifferent


def test_nothing_applicable_gives_no_action() -> None:
    decided = corridor(locked=True)
    assert (decided.action, decided.name, decided.path, decided.reward) == (None, None, (), 0.0)
    assert not decided.safe
    assert not decided.indifferent
    assert (decided.bound, decided.depth) == (Bound.EXHAUSTED, 1)
    assert decided.graph.number_of_nodes() == 1


def test_a_domain_without_actions_or_fluents_is_planned_too() -> None:
    decided = MonitorReplanner(load("(define (domain empty) (:predicates (unsafe)))")).plan([])
    assert decided.action is None
    assert decided.bound is Bound.EXHAUSTED
    constant = load(
        "(define (domain constant) (:functions (reward))"
        " (:action wait :parameters () :precondition (and) :effect (and (increase (reward) 1))))"
    )
    decided = MonitorReplanner(constant, depth=3, discount=0.5).plan([])
    assert decided.reward == 1.75
    assert decided.graph.number_of_nodes() == 4


@pytest.mark.parametrize("budget", [1e-9, 0.02])
def test_a_time_budget_is_met_and_leaves_a_decision(budget: float) -> None:
    wide = "".join(
        f"(:action a{k} :effect (assign (x) (+ (* (x) {1 + k}.5) 0.{k + 1})))" for k in range(5)
    )
    model = load(f"(define (domain wide) (:functions (x) (reward)) {wide})")
    planner = MonitorReplanner(model, depth=50, max_nodes=800_000, time_budget=budget)
    start = time.perf_counter()
    decided = planner.plan([1.0])
    spent = time.perf_counter() - start
    assert decided.bound is Bound.TIME
    assert decided.action is not None
    assert len(decided.path) == decided.depth >= 1
    assert spent < budget + 10.0  # the machine may be busy; the whole graph takes minutes


# What does not fit ------------------------------------------------------------------------------


def test_a_planner_needs_a_model_and_time() -> None:
    with pytest.raises(SettingsError, match=r"such as `domain\.model`"):
        MonitorReplanner("cartpole")  # type: ignore[arg-type]
    for budget in (0.0, -1.0, float("nan")):
        with pytest.raises(SettingsError, match="time_budget"):
            MonitorReplanner(world(0), time_budget=budget)


@pytest.mark.parametrize(
    ("state", "said"), [([1.0], "2 numbers"), ([1.0, float("nan")], "nan"), ([0.5, 1.0], "0 or 1")]
)
def test_a_state_that_does_not_fit_is_refused(state: list[float], said: str) -> None:
    with pytest.raises(StateError, match=said):
        MonitorReplanner(load(CORRIDOR)).plan(state)
