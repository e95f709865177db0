"""The planning graph as networkx has it."""

from __future__ import annotations

from random import Random

import networkx as nx
from hypothesis import given
from hypothesis import strategies as st

from serp.planning.graph import PlanningGraph
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings
from tests.generated.profile import examples
from tests.serp.planning.reference import Reference, as_state
from tests.serp.planning.test_lookahead import PLANNERS
from tests.serp.planning.worlds import WORLDS, load, states_of, world


@examples(200)
@given(st.integers(0, WORLDS - 1), PLANNERS, st.integers(0, 10**6))
def test_it_equals_one_that_is_built_edge_by_edge(
    seed: int, settings: PlannerSettings, state_seed: int
) -> None:
    model = world(seed)
    state = states_of(model, Random(state_seed), 1)[0]
    grown = PlanningGraph(model, settings, state)
    grown.grow()
    grown.evaluate()
    graph = grown.to_networkx()
    expected = Reference(model, settings).graph(as_state(state), grown.depth)
    assert nx.utils.graphs_equal(graph, expected)


def test_an_end_and_a_going_on_in_the_same_state_are_two_nodes() -> None:
    """What can still be earned differs."""
    model = load(
        """
        (define (domain ends)
          (:predicates (terminal))
          (:functions (x) (reward))
          (:action stop :parameters () :precondition (and)
            :effect (and (increase (x) 1) (terminal)))
          (:action go :parameters () :precondition (and)
            :effect (and (increase (x) 1) (increase (reward) 1))))
        """
    )
    decided = MonitorReplanner(model, depth=3, discount=1.0).plan([0.0])
    assert decided.forecast.value.tolist() == [0.0, 3.0]
    layer = [data for _, data in decided.graph.nodes(data=True) if data["layer"] == 1]
    assert sorted((data["state"], data["ended"]) for data in layer) == [
        ((1.0,), False),
        ((1.0,), True),
    ]
    assert all(decided.graph.out_degree(n) == 0 for n, e in decided.graph.nodes("ended") if e)
