"""The graph over cells sees ends that a lookahead does not, and otherwise leads to the unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.control.planners import closed_graph
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight.cell_graph import CellGraph
from serp.planning.far_sight.cell_values import Cells, cell_of, cell_value_at, pack
from serp.planning.far_sight.planner import FarSightPlanner
from serp.planning.forecast import Forecast
from serp.settings import PlannerSettings
from serp.sysid.transitions import TransitionMemory
from tests.serp.planning.worlds import load

SETTINGS = PlannerSettings(depth=3)

TRACK = """
(define (domain track)
  (:predicates (unsafe) (terminal))
  (:functions (x) (reward))
  (:action left :parameters () :precondition (and)
    :effect (and (decrease (x) (+ 0.13 (* 0.001 (x))))))
  (:action right :parameters () :precondition (and)
    :effect (and (increase (x) (+ 0.11 (* 0.001 (x))))))
  (:action rush :parameters () :precondition (and)
    :effect (and (increase (x) 0.9) (unsafe)))
  (:event time :parameters () :precondition (and) :effect (and (decrease (reward) 1)))
  (:event end :parameters () :precondition (and (>= (x) 5.0)) :effect (and (terminal))))
"""


def track() -> TransitionModel:
    return load(TRACK)


def along(low: float, high: float) -> Vector:
    return np.linspace(low, high, 200)[:, None] + 0.001


def planner_after(states: Vector) -> FarSightPlanner:
    planner = closed_graph(track(), SETTINGS)
    assert isinstance(planner, FarSightPlanner)
    planner.visited = memory = TransitionMemory(1_000, 1, 3)
    for state in states:
        memory.add(state, 0, state, 0)
    return planner


def test_an_end_far_beyond_the_lookahead_is_seen_where_it_is_known() -> None:
    planner = planner_after(along(-1.0, 4.999))
    near = planner.forecast(np.array([4.0]))
    far = planner.forecast(np.array([0.0]))
    assert not planner.cells.explores
    assert far.choice == near.choice == 1
    assert far.value[1] < near.value[1]


@pytest.mark.parametrize(("at", "choice"), [(0.4, 0), (1.7, 1)])
def test_where_nothing_is_known_to_reach_the_plan_leads_to_the_nearest_unknown(
    at: float, choice: int
) -> None:
    planner = planner_after(along(0.0, 2.0))
    assert planner.forecast(np.array([at])).choice == choice
    assert planner.cells.explores


def test_the_way_avoids_what_the_file_flags() -> None:
    planner = planner_after(along(-1.0, 4.999))
    for x in np.linspace(-1.0, 4.5, 12):
        assert planner.forecast(np.array([x])).choice != 2


def test_equal_experience_gives_equal_bits() -> None:
    def bits() -> list[bytes]:
        planner = planner_after(along(-1.0, 4.999))
        found: list[Forecast] = [planner.forecast(np.array([x])) for x in (0.1, 1.3)]
        planner.begin_episode()
        found.append(planner.forecast(np.array([0.1])))
        return [each.value.tobytes() for each in found]

    first = bits()
    assert first == bits()
    assert first[0] == first[2]


def test_without_continuous_fluents_or_experience_there_are_no_cells() -> None:
    graph = CellGraph(track(), SETTINGS)
    assert not graph.build(np.zeros(1), along(0.0, 2.0)[:5])
    assert not graph.build(np.zeros(1), np.round(along(0.0, 9.0)))
    assert not graph.values.size


@pytest.mark.parametrize("most", [30, 60, 300])
def test_a_graph_keeps_within_its_budget(most: int) -> None:
    graph = CellGraph(track(), SETTINGS, max_edges=most)
    if graph.build(np.zeros(1), along(-1.0, 4.999)):
        assert graph.edges <= most + 3
        assert graph.values.size
    else:
        assert not graph.values.size


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=20), st.floats(-9, 9))
@settings(max_examples=50, deadline=None)
def test_a_value_lies_between_those_of_cells_or_is_that_of_the_unknown(
    visited: list[float], at: float
) -> None:
    low, scale, unit = np.array([-3.0]), np.array([2.0]), np.array([1 / 6])
    by_cell = {int(cell_of(np.array([x]), low, scale, -1, 0)): x for x in visited}
    states = np.array(list(by_cell.values()))
    values = states**2
    cells = tuple(Cells(low, scale, unit, states, 0.1))
    digests = np.array(list(by_cell), dtype=np.uint64)
    packed = pack(cells, digests, states, values, -7.0)
    found = cell_value_at(packed, np.array([at]), 0, 1)
    near = np.abs(states - at) / 6 <= 0.1
    if near.any() or found != -7.0:
        assert values.min() - 1e-9 <= found <= values.max() + 1e-9
    else:
        assert found == -7.0


def test_numbers_that_are_not_finite_have_a_cell() -> None:
    low, scale = np.zeros(1), np.ones(1)
    for number in (np.nan, np.inf, -np.inf, 1e300):
        cell_of(np.array([number]), low, scale, -1, 0)
