"""The graph over cells sees ends that a lookahead does not, and otherwise leads to the unknown."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp._core import AREAS, CellValues
from serp.agent.registry import far_sight
from serp.errors import RunError
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import UNKNOWN
from serp.planning.cell_graph import CellGraph
from serp.planning.forecast import Bound
from serp.settings import AdaptationSettings, PlannerSettings
from tests.serp.planning.worlds import load
from tests.worlds import text

SETTINGS = PlannerSettings(depth=3)


def track():
    return load(text("track"))


def along(low, high):
    return np.linspace(low, high, 200)[:, None] + 0.001


def contents(values):
    return {name: column.tolist() for name, column in values.columns().items()}


def planner_after(states, saved=50_000, model=None):
    """Return a planner that has saved so many steps, after experience."""
    planner = far_sight(model or track(), SETTINGS)
    planner.visited = memory = TransitionMemory(1_000, 1, 3)
    for state in states:
        memory.add(state, 0, state, 0)
    planner._saved = saved
    return planner


def test_an_end_far_beyond_the_lookahead_is_seen_where_it_is_known():
    planner = planner_after(along(-1.0, 4.999))
    near = planner.forecast(np.array([4.0]))
    far = planner.forecast(np.array([0.0]))
    assert not planner.cells.explores
    assert far.choice == near.choice == 1
    assert far.value[1] < near.value[1]


@pytest.mark.parametrize(("at", "choice"), [(0.4, 0), (1.7, 1)])
def test_where_nothing_is_known_to_reach_the_plan_leads_to_the_nearest_unknown(at, choice):
    planner = planner_after(along(0.0, 2.0))
    found = planner.forecast(np.array([at]))
    assert (found.choice, found.bound) == (choice, Bound.UNKNOWN)
    assert planner.cells.explores


def test_the_way_avoids_what_the_file_flags():
    planner = planner_after(along(-1.0, 4.999))
    for x in np.linspace(-1.0, 4.5, 12):
        assert planner.forecast(np.array([x])).choice != 2


def test_what_was_found_is_restored_bit_for_bit():
    planner, other = planner_after(along(-1.0, 4.999)), planner_after(along(-1.0, 4.999))
    near = planner.forecast(np.array([0.1]))
    other.load_state_dict(*planner.state_dict())
    for x in (0.1, 1.3, 4.1):
        one, again = planner.forecast(np.array([x])), other.forecast(np.array([x]))
        assert one.value.tobytes() == again.value.tobytes()
    assert near.bound is Bound.CELLS


def test_the_account_bounds_what_is_predicted():
    planner = planner_after(along(-1.0, 4.999), saved=0)
    cells = planner.cells
    spent, decisions = 0, 3_000
    memory = planner.visited
    for decision in range(decisions):
        cells.steps = 0
        state = np.array([0.1 + 0.001 * decision])
        planner.forecast(state)
        spent += cells.steps
        memory.add(state, 0, state, 0)
    assert cells.values is not None
    earned = 1 + 0.25 * (3 + 9 + 27)
    # Coarser and finer attempts come on top of what was saved.
    assert spent <= 4 * earned * decisions


def test_without_continuous_fluents_or_experience_there_are_no_cells():
    graph = CellGraph(track(), SETTINGS)
    assert not graph.build(np.zeros(1), along(0.0, 2.0)[:5], 9_000)
    assert not graph.build(np.zeros(1), np.round(along(0.0, 9.0)), 9_000)
    assert graph.values is None


def test_states_and_former_values_of_other_fluents_are_refused():
    graph, one, two = CellGraph(track(), SETTINGS), np.ones(1), np.ones(2)
    core, model = graph._core, track().core
    for low, scale, area, roots in (
        (one, one, one, np.zeros((3, 2))),
        (two, two, two, np.zeros((3, 2))),
        (one, two, one, np.zeros((3, 1))),
        (one, one, two, np.zeros((3, 1))),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            core.expand(model, low, scale, area, roots, 100, UNKNOWN)
    assert core.expand(model, 0 * one, one, one, np.zeros((1, 1)), 900, UNKNOWN)[1]
    with pytest.raises(ValueError, match="no values"):
        core.solve(0.0, 0.0)
    with pytest.raises(ValueError, match="other fluents"):
        core.begin(CellValues(two, two, two, two, np.ones(2)), 0.0)
    values = CellValues(two, two, two, two, np.ones(2))
    for state in (np.ones(1), np.ones(3)):
        with pytest.raises(ValueError, match="2 numbers"):
            values.at(state)
        with pytest.raises(ValueError, match="2 numbers"):
            values.set(state, 1.0)


def restored(columns):
    """Return the values of cells that a graph of one fluent reads."""
    graph = CellGraph(track(), SETTINGS)
    graph.load_state_dict(columns, {"bins": 0.0, "explores": False})
    return graph.values


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=20), st.floats(-9, 9))
@settings(max_examples=50, deadline=None)
def test_a_value_lies_between_those_of_cells_and_beyond_the_range_is_that_of_the_unknown(
    visited, at
):
    low, scale, area = np.array([-3.0]), np.array([2.0]), np.array([AREAS / 6.0])
    by_cell = {int(np.floor(2.0 * (x + 3.0))): x for x in visited}
    states = np.array(list(by_cell.values()))
    values = CellValues(low, scale, area, states, np.append(states**2, -7.0))
    found = values.at(np.array([at]))
    if -4.5 <= at <= 4.5:  # the range and a quarter of it
        assert (states**2).min() - 1e-9 <= found <= (states**2).max() + 1e-9
    else:
        assert found == -7.0
    assert contents(restored(values.columns())) == contents(values)


@given(
    st.sampled_from(["low", "scale", "area", "states", "value", "area_value"]),
    st.integers(0, 20),
    st.floats(allow_nan=True),
)
@settings(max_examples=100, deadline=None)
def test_values_of_cells_that_were_forged_are_refused_or_do_no_harm(name, place, number):
    states, one = np.linspace(0.0, 3.0, 20), np.ones(1)
    values = CellValues(0 * one, 8 * one, 2 * one, states, np.append(states, -1.0))
    saved = values.columns()
    with pytest.raises(RunError):
        restored(saved | {name: saved[name][:-1]})
    with pytest.raises(RunError):
        restored(saved | {name: np.zeros(0)})
    saved[name][place % len(saved[name])] = number
    with contextlib.suppress(RunError):
        restored(saved).at(np.array([1.0]))


# Without a word on dynamics in the file, what it promises far away is found ---------------------


@pytest.mark.parametrize(
    ("cost", "time", "prize"), [(0.1, 0, 100), (0.02, 0, 1), (0.0, 1, 0), (0.0, 0, 1)]
)
def test_a_prize_that_was_never_seen_is_found_whatever_acting_costs(cost, time, prize):
    domain = text("unknown-track").replace("0.1", f"{cost}").replace("100", f"{prize}")
    domain = domain.replace("(reward) 0)", f"(reward) {time})")
    adaptation = ModelAdaptation(
        load(domain), AdaptationSettings(mode="residual"), np.random.SeedSequence(0)
    )
    planner = far_sight(adaptation.model, PlannerSettings())
    planner.visited = adaptation.experience
    state, random = np.zeros(2), np.random.default_rng(0)
    for step in range(800):
        # At first a robot tries what its actions do.
        action = planner.forecast(state).choice if step > 40 else int(random.integers(3))
        place, speed = state
        speed += 0.02 * (action - 1) - 0.01 * np.sin(2.0 * place)
        after = np.array([place + 0.5 * speed, 0.98 * speed])
        if after[0] >= 4.0:
            return
        adaptation.observe(state, action, after, False)
        state = after
    pytest.fail(f"not found; the last place is {state[0]:.2f}")
