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
    assert graph.pred == expected.pred
    # networkx keeps one dictionary for both directions; so an edit is seen from either side.
    for source, target, key, attributes in graph.edges(keys=True, data=True):
        assert graph.pred[target][source][key] is attributes


def test_it_can_be_changed_copied_and_walked_like_any_graph() -> None:
    graph = MonitorReplanner(world(5), depth=3).plan(states_of(world(5), Random(1), 1)[0]).graph
    assert nx.is_directed_acyclic_graph(graph)
    assert nx.descendants(graph, 0) == set(graph) - {0}
    assert nx.utils.graphs_equal(graph.copy(), graph)
    assert nx.utils.graphs_equal(graph.reverse().reverse(), graph)
    edges = graph.number_of_edges()
    node = max(graph)
    entering = graph.in_degree(node)
    graph.remove_node(node)
    assert graph.number_of_edges() == edges - entering
    graph.add_edge(0, 0, action="loop")
    assert graph.has_edge(0, 0)


def test_the_chosen_edges_are_the_path_of_the_plan() -> None:
    for seed in range(WORLDS):
        model = world(seed)
        for state in states_of(model, Random(seed), 3):
            decided = MonitorReplanner(model, depth=3).plan(state)
            chosen = [e for e in decided.graph.edges(data=True) if e[2]["chosen"]]
            chosen.sort(key=lambda edge: decided.graph.nodes[edge[0]]["layer"])
            assert [e[2]["action"] for e in chosen] == [step.action for step in decided.path]
            assert [e[2]["reward"] for e in chosen] == [step.reward for step in decided.path]
            ends = [decided.graph.nodes[target]["state"] for _, target, _ in chosen]
            assert ends == [step.state for step in decided.path]


def test_it_is_made_once_and_only_when_asked_for() -> None:
    decided = MonitorReplanner(world(5), depth=2).plan(states_of(world(5), Random(1), 1)[0])
    assert decided.graph is decided.graph


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


def test_positive_and_negative_zero_are_one_state() -> None:
    model = load(
        "(define (domain zeros) (:functions (x) (reward))"
        " (:action plus :parameters () :precondition (and) :effect (and (scale-up (x) 1)))"
        " (:action minus :parameters () :precondition (and) :effect (and (scale-up (x) -1))))"
    )
    decided = MonitorReplanner(model, depth=4).plan([0.0])
    assert decided.graph.number_of_nodes() == 5
