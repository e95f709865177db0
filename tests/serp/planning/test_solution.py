"""What a solved graph shows of every action: its Bellman backup, in the order of the choice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.registry import far_sight
from serp.model.flags import APPLICABLE
from serp.planning.array_graph import ENDED, GraphArrays
from serp.planning.edges import Bound, FirstActions
from serp.planning.forecast import Forecast, score_of
from serp.planning.preference import marked
from serp.planning.value_iteration import ALIKE, largest_value, look_up, solve
from serp.settings import PlannerSettings
from tests.generated import examples
from tests.serp.planning import worlds

ACTIONS, NODES = 3, 4
EXACT = 1e-6

Outcomes = dict[int, float]
"""Node, or `ENDED` → probability."""
Arcs = list[tuple[int, float, float, Outcomes]]
"""Action, reward, hazard and outcomes of every edge out of a node."""


@st.composite
def decision_processes(draw: st.DrawFn) -> tuple[list[Arcs], float]:
    """Small decision processes, many of whose actions lead back to where they begin; a discount."""
    discount = draw(st.sampled_from((0.5, 0.9, 0.99)))
    hazards = draw(st.sampled_from(((0.0,), (0.0, 0.0, 0.25, 1.0), (0.25, 0.5))))
    process = []
    for node in range(NODES):
        arcs = []
        for action in draw(st.sets(st.integers(0, ACTIONS - 1))):
            ends = draw(st.lists(st.integers(ENDED, NODES - 1), max_size=2, unique=True))
            ends = list({*ends, node}) if not ends or draw(st.booleans()) else ends
            weights = [draw(st.integers(1, 4)) for _ in ends]
            chances = {end: w / sum(weights) for end, w in zip(ends, weights, strict=True)}
            reward = float(draw(st.integers(-4, 4)))
            arcs.append((action, reward, draw(st.sampled_from(hazards)), chances))
        process.append(arcs)
    return process, discount


def graph_of(process: list[Arcs]) -> GraphArrays:
    """Return the graph of a decision process, expanded."""
    graph = GraphArrays.allocate(NODES, NODES * ACTIONS, NODES * ACTIONS * (NODES + 1), 1)
    edges = outcomes = 0
    for node, arcs in enumerate(process):
        for action, reward, hazard, chances in arcs:
            graph.action[edges], graph.reward[edges], graph.hazard[edges] = action, reward, hazard
            graph.flags[edges] = marked(APPLICABLE, hazard)
            for target, chance in chances.items():
                graph.target[outcomes], graph.chance[outcomes] = target, chance
                outcomes += 1
            edges += 1
            graph.first_outcome[edges] = outcomes
        graph.first_edge[node + 1] = edges
    graph.counters[:] = NODES, NODES, edges, outcomes
    return graph


def shown(graph: GraphArrays, node: int, discount: float) -> Forecast:
    """Return the forecast for a node of a solved graph."""
    found = FirstActions.allocate(ACTIONS)
    unit = ALIKE * largest_value(tuple(graph))
    choice = look_up(tuple(graph), node, (discount, 0.0), unit, tuple(found))
    return Forecast(choice, *found, 0, Bound.EXHAUSTED)


@given(decision_processes())
@examples(200)
def test_what_is_shown_is_one_step_and_then_the_best_policy(
    drawn: tuple[list[Arcs], float],
) -> None:
    process, discount = drawn
    graph = graph_of(process)
    solve(tuple(graph), discount, 0.0)
    alike = 10 * ALIKE * max(1.0, float(np.abs(graph.value).max()))

    def after(values: np.ndarray, chances: Outcomes) -> float:
        return sum(p * values[end] for end, p in chances.items() if end != ENDED)

    for node, arcs in enumerate(process):
        forecast = shown(graph, node, discount)
        for action, reward, hazard, chances in arcs:
            value = reward + discount * after(graph.value, chances)
            risk = hazard + (1.0 - hazard) * discount * after(graph.risk, chances)
            assert abs(forecast.value[action] - value) <= alike
            assert abs(forecast.path_risk[action] - risk) <= 10 * ALIKE
        if arcs:
            best = max((a for a, *_ in arcs), key=lambda a: (score_of(forecast, a), -a))
            assert forecast.choice == best
            assert abs(forecast.path_risk[best] - graph.risk[node]) <= 10 * ALIKE
            if graph.risk[node] == 0.0:
                assert abs(forecast.value[best] - graph.value[node]) <= alike


WAITING = """
(define (domain waiting)
  (:predicates (open) (terminal))
  (:functions (reward))
  (:action wait :parameters () :precondition (and) :effect (and))
  (:action open :parameters () :precondition (and) :effect (and (open)))
  (:action leave :parameters () :precondition (and (open))
    :effect (and (increase (reward) 10) (terminal))))
"""


@pytest.mark.parametrize("discount", [0.99, 1.0])
def test_waiting_is_worth_what_it_can_lead_to_and_is_not_chosen(discount: float) -> None:
    model = worlds.load(WAITING)
    planner = far_sight(model, PlannerSettings(discount=discount))
    state = np.zeros(1)
    for name, worth in (("open", 10 * discount), ("leave", 10.0)):
        forecast = planner.forecast(state)
        assert model.actions[forecast.choice].name == name and not forecast.indifferent
        assert forecast.value[forecast.choice] == pytest.approx(worth, abs=EXACT)
        assert forecast.value[0] == pytest.approx(discount * worth, abs=EXACT)
        state = model.step(state, forecast.choice).state
