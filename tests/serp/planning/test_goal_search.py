"""The search for a way to the goal: what it finds is a way, and it is found where graphs end."""

import functools
import itertools
import sys
from pathlib import Path
from random import Random

import numpy as np
import pytest

from serp._core import Relaxation, WaySearch
from serp.agent.registry import far_sight
from serp.model.domain import load_domain
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.ground_model import comparisons_of
from serp.planning.closed_graph import ClosedGraph
from serp.planning.forecast import Bound
from serp.planning.goal_search import GoalSearch, relaxed
from serp.planning.inert import inert_fluents
from serp.settings import PlannerSettings
from tests.generated import FULL, PLANNABLE, Texts, generate, load_texts, random_states
from tests.worlds import text

SETTINGS = PlannerSettings()
FILES = Path(__file__).parents[1] / "model" / "pddl_files"

TO_SAVE = """
(define (problem p) (:domain boat) (:init (= (x) 0) (= (y) 0) (= (spent) 0))
  (:goal (and (saved))) {metric})
"""


def boat(far, metric=""):
    texts = Texts(text("boat").replace(" 12)", f" {far})"), TO_SAVE.format(metric=metric))
    return load_texts(texts).model


def successors(model, state):
    """The next states, and whether some action reaches the goal."""
    found, ended = [], False
    for action in range(len(model.actions)):
        out, flags = model.transition(state.tolist(), action)
        if flags & APPLICABLE and flags & TERMINAL:
            ended = ended or out[-1] > 0.0
        elif flags & APPLICABLE:
            found.append(out[:-1])
    return found, ended


def check_way(model, way):
    """Every state follows from the one before, and the goal from the last; costs may differ."""
    relevant = np.setdiff1d(np.arange(way.shape[1]), inert_fluents(model))
    for state, following in itertools.pairwise(way):
        targets = np.array(successors(model, state)[0])[:, relevant]
        assert (targets == following[relevant]).all(axis=1).any()
    assert successors(model, way[-1])[1]


@pytest.mark.parametrize("name", ["briefcase", "counters", "logistics", "warehouse"])
def test_a_way_to_the_goal_of_a_problem_file_is_found(name):
    model = load_domain(FILES / f"{name}.pddl").model
    search = GoalSearch(model, SETTINGS)
    way = search.way(model.initial_state, 5_000)
    assert 0 < search.steps <= 5_000 and (way[0] == model.initial_state).all()
    check_way(model, way)
    again = GoalSearch(model, SETTINGS).way(model.initial_state, 5_000)
    assert again is not None and again.tobytes() == way.tobytes()


def test_numbers_without_bounds_are_followed_in_the_right_direction():
    model = boat(120.0)
    search = GoalSearch(model, SETTINGS)
    way = search.way(model.initial_state, 5_000)
    assert way is not None and 40 <= len(way) <= 60
    check_way(model, way)
    assert search.way(model.initial_state, 20) is None
    assert GoalSearch(boat(1e9), SETTINGS).way(way[0], 2_000) is None


def test_a_search_goes_on_where_the_world_follows_it():
    model = boat(120.0)
    search, state = GoalSearch(model, SETTINGS), model.initial_state
    for _ in range(40):
        if search.way(state, 60) is not None:
            break
        resumed = GoalSearch(model, SETTINGS)
        resumed.load_state_dict(search.state_dict())
        assert resumed.least == search.least
        while (action := search.toward(state)) >= 0:
            assert resumed.toward(state) == action
            state = model.step(state, action).state
    assert search.toward(state) >= 0  # the way that was found
    for _ in range(200):
        outcome = model.step(state, search.toward(state))
        state = outcome.state
        if outcome.terminal:
            break
    assert outcome.terminal and outcome.reward > 0.0


def test_a_search_after_a_way_was_found_is_the_same_after_a_restart():
    model = boat(120.0)
    search, resumed = GoalSearch(model, SETTINGS), GoalSearch(model, SETTINGS)
    way = search.way(model.initial_state, 5_000)
    resumed.load_state_dict(search.state_dict())
    ways = [s.way(way[5], 5_000) for s in (search, resumed)]
    assert ways[0].tobytes() == ways[1].tobytes() and search.steps == resumed.steps


def test_a_way_that_was_left_is_mended():
    model = load_domain(FILES / "logistics.pddl").model
    search, state = GoalSearch(model, SETTINGS), model.initial_state
    assert search.way(state, 5_000) is not None
    anew, plan = search.steps, []
    while not model.at_goal(state):
        plan.append(search.toward(state))
        state = model.step(state, plan[-1]).state
    for slipped in successors(model, model.initial_state)[0]:
        mended, resumed = GoalSearch(model, SETTINGS), GoalSearch(model, SETTINGS)
        way = mended.way(np.array(slipped), 5_000, plan)
        assert way is not None and len(way) <= len(plan) + 1 and mended.steps < anew
        check_way(model, way)
        resumed.load_state_dict(mended.state_dict())
        assert resumed.toward(way[0]) == mended.toward(way[0]) >= 0
    # What the goal does not need is left out: here every action comes twice.
    way = GoalSearch(model, SETTINGS).way(model.initial_state, 5_000, [*plan, *plan])
    assert way is not None and len(way) <= len(plan)
    check_way(model, way)
    assert GoalSearch(boat(1e9), SETTINGS).way(np.zeros(4), 50, [0]) is None


def roads(random, places):
    """A walk between places; some roads lead in one direction only."""
    ends = [(random.randrange(k), k) for k in range(1, places)]
    ends += [(b, a) for a, b in ends]
    ends += [(random.randrange(places), random.randrange(places)) for _ in range(4)]
    facts = " ".join(f"(road p{a} p{b})" for a, b in sorted(set(ends)) if a != b)
    names = " ".join(f"p{k}" for k in range(places))
    domain = (
        "(define (domain d) (:types place) (:predicates (at ?p - place) (road ?p ?q - place))"
        " (:action go :parameters (?p ?q - place) :precondition (and (at ?p) (road ?p ?q))"
        " :effect (and (not (at ?p)) (at ?q))))"
    )
    problem = (
        f"(define (problem p) (:domain d) (:objects {names} - place)"
        f" (:init (at p0) {facts}) (:goal (and (at p{places - 1}))))"
    )
    return load_texts(Texts(domain, problem)).model


@pytest.mark.parametrize("kind", range(4))
def test_a_way_begins_where_the_world_is_though_it_was_there_before(kind):
    """What the tree knew of its first root does not count when that is the root again."""
    for seed in range(40):
        random = Random(seed)
        model = roads(random, random.randint(6, 14))
        relaxation = relaxed(model.ground, model.theta.tolist())
        search = WaySearch(model.core, relaxation, *2 * [np.zeros(0, np.int64)], 0.0, kind)
        state = model.initial_state
        for _ in range(40):
            _, way = search.search(state, random.randint(1, 6))
            if way is not None:
                assert (way[0] == state).all()
                check_way(model, way)
                break
            search.toward(state)
            following, ended = successors(model, state)
            if ended:
                break
            state = np.array(random.choice(following))


def test_a_search_keeps_model_and_relaxation_as_long_as_it_lives():
    model = boat(120.0)
    core, relaxation = model.core, relaxed(model.ground, model.theta.tolist())
    before = [sys.getrefcount(kept) for kept in (core, relaxation)]
    search = WaySearch(core, relaxation, np.zeros(0, np.int64), np.arange(4), 0.0, 1)
    assert [sys.getrefcount(kept) for kept in (core, relaxation)] == [n + 1 for n in before]
    del search
    assert [sys.getrefcount(kept) for kept in (core, relaxation)] == before


def test_what_is_added_may_depend_on_the_state():
    domain = (
        "(define (domain d) (:functions (x) (v))"
        " (:action push :effect (and (increase (v) 1)))"
        " (:action move :effect (and (increase (x) (* 2 (v))))))"
    )
    problem = "(define (problem p) (:domain d) (:init (= (x) 0) (= (v) 0)) (:goal (and {})))"
    for goal, estimates in (
        ("(>= (x) 12)", {(0, 0): 7.0, (0, 1): 6.0, (0, 3): 2.0, (10, 1): 1.0, (12, 0): 0.0}),
        ("(not (= (x) 4))", {(4, 0): 2.0, (4, 1): 1.0, (3, 0): 0.0}),
    ):
        model = load_texts(Texts(domain, problem.format(goal))).model
        relaxation = relaxed(model.ground, model.theta.tolist())
        for numbers, cost in estimates.items():
            assert relaxation.estimate(np.array(numbers, float))[0] == cost


def test_a_way_is_safe_and_a_domain_without_a_goal_has_none():
    domain = (
        "(define (domain d) (:predicates (unsafe) (terminal)) (:functions (x) (reward))"
        " (:action jump :effect (and (assign (x) 5) {}))"
        " (:action walk :effect (and (increase (x) 1)))"
        " (:event home :precondition (= (x) 5) :effect (and {} (increase (reward) 1))))"
    )
    for jump, ends, length in (("", "(terminal)", 1), ("(unsafe)", "(terminal)", 5), ("", "", 0)):
        model = load_texts(Texts(domain.format(jump, ends), None)).model
        search = GoalSearch(model, SETTINGS)
        way = search.way(np.zeros(1), 100)
        assert search.goal == bool(ends) and (0 if way is None else len(way)) == length


@pytest.mark.parametrize("seed", range(40))
def test_nothing_is_left_of_the_goal_where_it_holds(seed):
    random = Random(f"left {seed}")
    model = generate(random, PLANNABLE if seed % 2 else FULL).model
    goal, relaxation = model.ground.goal, relaxed(model.ground, model.theta.tolist())
    if goal is None:
        return
    exact = not any(comparisons_of(goal))  # a comparison may be more than the relaxation can say
    for state in random_states(random, model, 6, exact=True):
        cost, left = relaxation.estimate(state)
        assert (cost == 0.0) == (left == 0)
        assert left == 0 if model.at_goal(state) else left > 0 or not exact


def test_what_leads_outside_of_tables_or_states_is_refused():
    sound = {
        "fluents": 2,
        "comparisons": [([(1, 2.0)], -3.0, False)],
        "operators": [([0, 0, 2], 1.0, [(4, 0.5, -1), (1, 0.0, -1)], 0)],
        "ways": [[4]],
    }
    # The operator is applied 6 times; in the other state it lacks that fluent 1 is 0.
    assert Relaxation(**sound).estimate(np.zeros(2)) == (6.0, 1)
    assert Relaxation(**sound).estimate(np.array([0.0, 1.0])) == (np.inf, 1)
    for wrong in (
        {"comparisons": [([(2, 2.0)], -3.0, False)]},
        {"operators": [([5], 1.0, [], 0)]},
        {"operators": [([-1], 1.0, [], 0)]},
        {"operators": [([], 1.0, [(5, 0.0, -1)], 0)]},
        {"operators": [([], 1.0, [(3, 0.5, -1)], 0)]},  # not a comparison
        {"operators": [([], -1.0, [], 0)]},
        {"operators": [([], 1.0, [(4, 0.0, 5)], 0)]},
        {"operators": [([], 1.0, [(4, 0.0, 0)], 0)]},  # not a comparison
        {"operators": [([], 1.0, [], -2)]},
        {"ways": [[0], [5]]},
        {"fluents": -1},
    ):
        with pytest.raises(ValueError, match=r"\w"):
            Relaxation(**sound | wrong)
    with pytest.raises(ValueError, match="2 numbers"):
        Relaxation(**sound).estimate(np.zeros(3))
    core, tables = boat(9.0).core, relaxed(boat(9.0).ground, boat(9.0).theta.tolist())
    for relaxation, inert, kind, state in (
        (Relaxation(**sound), [], 0, np.zeros(4)),
        (tables, [], 0, np.zeros(3)),
        (tables, [4], 0, np.zeros(4)),
        (tables, [-1], 0, np.zeros(4)),
        (tables, [], 5, np.zeros(4)),
        (tables, [], -1, np.zeros(4)),
        (Relaxation(4, [], [([], 1.0, [], 9)], []), [], 0, np.zeros(4)),
    ):
        with pytest.raises(ValueError, match=r"fluent|action|numbers|search"):
            search = WaySearch(core, relaxation, np.array(inert, np.int64), np.arange(4), 0.0, kind)
            search.search(state, 10)


@pytest.mark.parametrize("seed", range(40))
def test_nothing_depends_on_an_inert_fluent(seed):
    random = Random(f"inert {seed}")
    model = generate(random, PLANNABLE if seed % 2 else FULL).model
    states = random_states(random, model, 4, exact=True)
    inert = inert_fluents(model)
    relevant = np.setdiff1d(np.arange(states.shape[1]), inert)
    for state in states:
        other = state.copy()
        other[inert] = [0.0 if model.fluents[k].numeric else 1.0 - state[k] for k in inert]
        for action in range(len(model.actions)):
            one, flags = model.transition(state.tolist(), action)
            two, same = model.transition(other.tolist(), action)
            assert flags == same
            if flags & APPLICABLE:
                assert np.array(one)[relevant].tobytes() == np.array(two)[relevant].tobytes()
                assert one[-1] == pytest.approx(two[-1], rel=1e-9, abs=1e-9)


# With the planner ------------------------------------------------------------------------------


def replanned(model, monkeypatch, most):
    """Replan in the model until the goal is reached; return the sum of rewards."""
    monkeypatch.setattr("serp.planning.far_sight._SMALL_GRAPH", most)
    planner = far_sight(model, SETTINGS)
    state, total = model.initial_state, 0.0
    for _ in range(100):
        forecast = planner.forecast(state)
        assert forecast.bound in (Bound.NODES, Bound.EXHAUSTED)
        outcome = model.step(state, forecast.choice)
        state, total = outcome.state, total + outcome.reward
        if outcome.terminal:
            return total
    raise AssertionError("the goal was not reached")


def test_the_graph_grows_around_a_way_where_it_cannot_hold_everything(monkeypatch):
    model = load_domain(FILES / "logistics.pddl").model
    assert all(replanned(model, monkeypatch, most) > 0.0 for most in (60, 300))
    assert replanned(boat(60.0), monkeypatch, 2_000) > 0.0
    graph = ClosedGraph(model := roads(Random(0), 200), SETTINGS)
    graph.grow(model.initial_state)
    assert graph.complete and graph.work > 2 * graph.edges  # most actions are tried in vain


def test_states_that_differ_in_what_was_spent_are_one(monkeypatch):
    spent = boat(12.0, "(:metric minimize (spent))")
    assert [spent.fluents[k].name for k in inert_fluents(spent)] == ["spent"]
    worth = float(spent.theta[-1])
    # 4 × north-west lacks 0 of y - x = 12, and x + y is 0 all the time: the cheapest way.
    assert replanned(spent, monkeypatch, 20_000) == pytest.approx(worth - 4.0)
    for metric in ("(:metric minimize (* (spent) (x)))", "(:metric maximize (/ 1 (spent)))"):
        assert len(inert_fluents(boat(8.0, metric))) == 0


PUSH = Path(__file__).parent / "files" / "push.pddl"
BOXES = """
(define (problem push-1) (:domain push) (:objects b0 b1 - box)
  (:init (= (x) 0) (= (y) 0) (= (bx b0) 0) (= (by b0) 1) (= (bx b1) 1) (= (by b1) 1))
  (:goal (and (= (bx b0) 2) (= (by b0) 2) (= (bx b1) 3) (= (by b1) 2))))
"""


@functools.cache
def push():
    """A room in which two boxes are pushed."""
    return load_texts(Texts(PUSH.read_text(encoding="utf-8"), BOXES)).model


def room(seed):
    """Two boxes and the player, at different places and none at a wall."""
    places = np.random.default_rng(seed).choice(16, 3, replace=False).tolist()
    values = {}
    names = (("bx b0", "by b0"), ("bx b1", "by b1"), ("x", "y"))
    for (across, down), place in zip(names, places, strict=True):
        values |= {across: 1 + place % 4, down: 1 + place // 4}
    return push().state(values)


def test_every_episode_of_a_puzzle_that_is_new_each_time_reaches_its_goal(monkeypatch):
    monkeypatch.setattr("serp.planning.far_sight._SMALL_GRAPH", 500)
    planner = far_sight(push(), SETTINGS)
    for episode in range(8):
        state = room(episode)
        planner.begin_episode()
        for _ in range(60):
            state = push().step(state, planner.forecast(state).choice).state
            if push().at_goal(state):
                break
        assert push().at_goal(state), episode
