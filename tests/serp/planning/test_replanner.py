"""Monitor-replanning on graphs made for it; `test_lookahead` holds it against plain recursion."""

import pytest

from serp.errors import SettingsError
from serp.model.transition_model import StateError
from serp.planning.forecast import Bound
from serp.planning.replanner import MonitorReplanner
from tests.serp.planning.worlds import load


def test_a_graph_of_objects_has_a_bounded_number_of_edges(monkeypatch):
    monkeypatch.setattr("serp.planning.replanner.MAX_EDGES", 200)
    wide = "".join(
        f"(:action a{k} :effect (assign (x) (+ (* (x) {1 + k}.5) 0.{k + 1})))" for k in range(5)
    )
    model = load(f"(define (domain wide) (:functions (x) (reward)) {wide})")
    decided = MonitorReplanner(model, depth=50, max_nodes=800_000).plan([1.0])
    assert decided.forecast.bound is Bound.NODES
    assert len(decided.path) == decided.forecast.depth == 3
    assert decided.graph.number_of_edges() == 5 + 25 + 125


# What does not fit ------------------------------------------------------------------------------


def test_a_planner_needs_a_model():
    with pytest.raises(SettingsError, match=r"such as `domain\.model`"):
        MonitorReplanner("cartpole")


LAMP = "(define (domain lamp) (:predicates (lit)) (:functions (x)) (:action go :effect (lit)))"


@pytest.mark.parametrize(
    ("state", "said"), [([1.0], "2 numbers"), ([1.0, float("nan")], "nan"), ([0.5, 1.0], "0 or 1")]
)
def test_a_state_that_does_not_fit_is_refused(state, said):
    with pytest.raises(StateError, match=said):
        MonitorReplanner(load(LAMP)).plan(state)
