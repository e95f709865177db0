"""Monitor-replanning on graphs made for it; `test_lookahead` holds it against plain recursion."""

import time

import pytest

from serp.errors import SettingsError
from serp.model.transition_model import StateError
from serp.planning.forecast import Bound
from serp.planning.replanner import MonitorReplanner
from tests.serp.planning.worlds import load, world


@pytest.mark.parametrize("budget", [1e-9, 0.02])
def test_a_time_budget_is_met_and_leaves_a_decision(budget):
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


def test_a_planner_needs_a_model_and_time():
    with pytest.raises(SettingsError, match=r"such as `domain\.model`"):
        MonitorReplanner("cartpole")
    for budget in (0.0, -1.0, float("nan")):
        with pytest.raises(SettingsError, match="time_budget"):
            MonitorReplanner(world(0), time_budget=budget)


LAMP = "(define (domain lamp) (:predicates (lit)) (:functions (x)) (:action go :effect (lit)))"


@pytest.mark.parametrize(
    ("state", "said"), [([1.0], "2 numbers"), ([1.0, float("nan")], "nan"), ([0.5, 1.0], "0 or 1")]
)
def test_a_state_that_does_not_fit_is_refused(state, said):
    with pytest.raises(StateError, match=said):
        MonitorReplanner(load(LAMP)).plan(state)
