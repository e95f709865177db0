"""What the far-sighted planner keeps is saved exactly, and damage is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.agent.registry import far_sight
from serp.errors import RunError
from serp.planning.closed_graph import ClosedGraph
from serp.settings import PlannerSettings
from tests.serp.planning.worlds import load
from tests.worlds import text

SETTINGS = PlannerSettings()
MODEL = load(text("way"))


def planner_at(*places):
    planner = far_sight(MODEL, SETTINGS)
    for x in places:
        planner.forecast(np.array([x]))
    return planner


@pytest.mark.parametrize("places", [(), (5.0,), (5.0, 5.5, 6.25)])
def test_a_restored_planner_goes_on_as_the_saved_one(places):
    planner, other = planner_at(*places), planner_at(9.75)
    other.load_state_dict(*planner.state_dict())
    for x in (4.0, 5.5, 7.75, 2.125):
        one, again = planner.forecast(np.array([x])), other.forecast(np.array([x]))
        for column, same in zip(one, again, strict=True):
            assert np.array_equal(column, same)
    arrays, meta = planner.state_dict()
    arrays_again, meta_again = other.state_dict()
    assert meta == meta_again and arrays.keys() == arrays_again.keys()
    assert all(np.array_equal(arrays[name], arrays_again[name]) for name in arrays)


def test_the_graph_is_kept_while_the_model_stands():
    planner = planner_at(5.0)
    graph, edges = planner.graph, planner.graph.edges
    for x in range(1, 30):
        planner.forecast(np.array([float(x)]))
    assert graph.edges == edges
    clear, cleared = graph.clear, []
    graph.clear = lambda: cleared.append(clear())
    MODEL.revision += 1
    try:
        planner.forecast(np.array([7.0]))
    finally:
        MODEL.revision -= 1
    assert cleared and graph.edges == edges  # built anew


def forged(arrays, name, place, value):
    changed = {key: array.copy() for key, array in arrays.items()}
    column = changed[name]
    with np.errstate(all="ignore"):
        column[place % len(column)] = np.array(value).astype(column.dtype)
    return changed


SAVED = planner_at(5.0, 5.5).graph.state_dict()
NAMES = sorted(name for name, column in SAVED.items() if column.size)


@given(
    st.sampled_from(NAMES),
    st.integers(0, 10_000),
    st.sampled_from([-(2.0**40), -2.0, -1.0, 0.0, 1.0, 7.0, 1e6, 2.0**31, np.nan, np.inf]),
)
@settings(max_examples=200, deadline=None)
def test_a_forged_graph_is_refused_or_does_no_harm(name, place, value):
    graph = ClosedGraph(MODEL, SETTINGS)
    try:
        graph.load_state_dict(forged(SAVED, name, place, value))
    except RunError:
        return
    for x in (5.0, 5.5, 8.0):
        graph.forecast(np.array([x]))
    graph.grow(np.array([3.25]))


@pytest.mark.parametrize("name", NAMES)
def test_a_graph_with_a_part_missing_or_cut_off_is_refused(name):
    graph = ClosedGraph(MODEL, SETTINGS)
    with pytest.raises(RunError):
        graph.load_state_dict({key: array for key, array in SAVED.items() if key != name})
    with pytest.raises(RunError):
        graph.load_state_dict(SAVED | {name: SAVED[name][:-1]})


@pytest.mark.parametrize(
    ("name", "value"),
    [("saved", 10**9), ("wait", -1), ("bins", 0.5), ("bins", -1.0), ("explores", 3), ("price", -1)],
)
def test_a_forged_account_is_refused(name, value):
    arrays, meta = planner_at(5.0).state_dict()
    with pytest.raises(RunError):
        planner_at().load_state_dict(arrays, meta | {name: value})
