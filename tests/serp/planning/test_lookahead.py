"""The plan is that of plain recursion, bit for bit, and so is the graph."""

import resource
from collections import Counter
from dataclasses import replace
from random import Random

import networkx as nx
import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

from serp import _core
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE
from serp.model.learned.adaptation import ModelAdaptation
from serp.planning.forecast import SAFE, Bound
from serp.planning.lookahead import Lookahead
from serp.planning.preference import free_of_risk, rank_of, step_risk
from serp.planning.replanner import MonitorReplanner
from serp.settings import AdaptationSettings, PlannerSettings
from tests.generated.profile import examples
from tests.serp.planning.reference import Reference, as_state
from tests.serp.planning.worlds import WORLDS, load, risky_world, states_of, world

MODELS = (*map(world, range(WORLDS)), *map(risky_world, range(WORLDS)))
SETTINGS = st.builds(
    PlannerSettings,
    depth=st.integers(1, 4),
    discount=st.sampled_from((1.0, 0.99, 0.9, 0.5)),
    max_nodes=st.sampled_from((1, 2, 3, 5, 8, 20, 60, 10_000)),
    accepted_risk=st.sampled_from((0.0, 0.02, 0.3)),
)


def bits(forecast):
    """All fields, arrays as their bytes: equal bits, -0.0 and NaN included."""
    return [
        (f.dtype, f.shape, f.tobytes()) if isinstance(f, np.ndarray) else int(f) for f in forecast
    ]


def plans_of(model, settings, states):
    lookahead = Lookahead(model, settings)
    plans = [MonitorReplanner(model, settings).plan(state) for state in states]
    for state, planned in zip(states, plans, strict=True):
        assert bits(lookahead.forecast(state)) == bits(planned.forecast)  # memory is used again
    return plans


def assert_as_by_recursion(reference, state, planned):
    model, root, forecast = reference.model, as_state(state), planned.forecast
    layers, bound = reference.layers(root)
    assert (planned.forecast.depth, planned.forecast.bound) == (layers, bound)
    best = reference.best(root, layers)
    names = [model.actions[arc.action].name for arc in best.arcs]
    assert [(step.action, step.state, step.reward, step.unsafe) for step in planned.path] == [
        (name, arc.state, arc.reward, arc.unsafe)
        for name, arc in zip(names, best.arcs, strict=True)
    ]
    assert [step.risk for step in planned.path] == [arc.risk for arc in best.arcs]
    assert planned.action == (best.arcs[0].action if best.arcs else None)
    assert planned.name == (names[0] if names else None)
    assert planned.reward == best.value
    assert planned.safe == (bool(best.arcs) and best.steps == SAFE)
    arcs = reference.arcs(root)
    paths = reference.counted([reference.along(arc, layers - 1) for arc in arcs])
    by_action = {arc.action: (arc, path) for arc, path in zip(arcs, paths, strict=True)}
    best_rank = min((arc.rank for arc in arcs), default=0)
    scores = [p.promise for arc, p in by_action.values() if arc.rank == best_rank]
    assert forecast.indifferent == (len(scores) > 1 and len(set(scores)) == 1)
    for action in range(len(model.actions)):
        found = (
            forecast.value[action], forecast.safe_steps[action], forecast.path_risk[action],
            bool(forecast.applicable[action]),
        )  # fmt: skip
        if action not in by_action:
            assert found == (-np.inf, -1, 1.0, False)
            continue
        arc, path = by_action[action]
        assert found == (path.value, path.steps, path.danger, True)
        outcome, flags = model.step(state, action), int(forecast.flags[action])
        assert forecast.reward[action] == outcome.reward
        assert forecast.unsafe[action] == outcome.unsafe
        assert bool(flags & TERMINAL) == outcome.terminal
        assert arc.rank == (2 if flags & UNSAFE else 1 if flags & RISKY else 0)


DOOR = """(define (domain door)
  (:predicates (open)) (:functions (x) (reward))
  (:action push :effect (and (open) (decrease (reward) 0.1)))
  (:action wait :effect (decrease (reward) 0.01))
  (:event draught :precondition (not (open)) :effect (decrease (reward) 1)))"""


@pytest.mark.parametrize(("opened", "choice"), [(1, 0), (0, 1)])
def test_what_fails_more_often_than_not_is_tried_again_and_what_never_works_is_not(opened, choice):
    model = load(DOOR)
    adaptation = ModelAdaptation(model, AdaptationSettings(mode="full"), np.random.SeedSequence(1))
    shut = np.zeros(2)
    for k in range(40):
        after = np.array([float(k % 10 < opened), 0.0])
        adaptation.observe(shut, 0, after, False, np.nan)
    forecast = Lookahead(adaptation.model).forecast(shut)
    assert forecast.choice == choice


def test_the_plan_is_that_of_plain_recursion():
    met = Counter()

    @examples(400)
    @given(
        model=st.sampled_from(MODELS),
        settings=SETTINGS,
        states_seed=st.integers(0, 10**6),
        memory=st.sampled_from((10**7, 10**7, 10**7, 60, 20, 1)),
    )
    def holds(model, settings, states_seed, memory):
        states = states_of(model, Random(states_seed), 2)
        reference = Reference(model, settings)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("serp.planning.lookahead.MAX_NUMBERS", memory * (len(model.fluents) + 1))
            for state, planned in zip(states, plans_of(model, settings, states), strict=True):
                assert_as_by_recursion(reference, state, planned)
                expected = reference.graph(as_state(state), planned.forecast.depth)
                assert nx.utils.graphs_equal(planned.graph, expected)
                values = planned.forecast.value[planned.forecast.applicable]
                met[planned.forecast.bound.name] += 1
                met["ties"] += len(values) != len(set(values.tolist()))
                met["unsafe"] += planned.action is not None and not planned.safe
                risks = [risk for *_, risk in planned.graph.edges(data="risk")]
                met["doubtful ends"] += bool((planned.forecast.flags >> 34).any())
                met["risks"] += any(0.0 < risk < 1.0 for risk in risks)

    holds()
    assert met.keys() == {"DEPTH", "NODES", "EXHAUSTED", "ties", "unsafe", "risks", "doubtful ends"}
    assert min(met.values()) >= 15, met


def test_positive_and_negative_zero_are_one_state():
    """One node a layer, so that four nodes are enough for depth 4."""
    model = load(
        "(define (domain zeros) (:functions (x) (reward))"
        " (:action plus :parameters () :precondition (and) :effect (and (scale-up (x) 1)))"
        " (:action minus :parameters () :precondition (and) :effect (and (scale-up (x) -1))))"
    )
    settings = PlannerSettings(depth=4, max_nodes=4)
    (planned,) = plans_of(model, settings, np.zeros((1, 1)))
    assert (planned.forecast.depth, planned.forecast.bound) == (4, Bound.DEPTH)


def test_memory_is_bounded_whatever_the_depth():
    """Five actions, depth 60: the whole tree has more nodes than there are atoms in the field."""
    model = load(
        "(define (domain wide) (:predicates (unsafe)) (:functions (x) (reward))"
        + "".join(
            f"(:action a{k} :parameters () :precondition (and) :effect (and"
            f" (assign (x) (+ (* (x) {1 + k}.5) 0.1))))"
            for k in range(5)
        )
        + ")"
    )
    settings = PlannerSettings(depth=60, max_nodes=20_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    forecast = Lookahead(model, settings).forecast(np.ones(1))
    added = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert forecast.bound is Bound.NODES
    assert forecast.depth == 7  # 1 + 5 + ... + 5^6 nodes; the next layer has 5^7
    assert added < 40_000  # KB


@pytest.mark.parametrize("number", range(3))
def test_forecasts_that_threads_compute_are_those_of_one(number, monkeypatch):
    """They are at hand in the body only, and only for the leaves that they were computed with."""
    monkeypatch.setattr("serp.planning.lookahead._WORTH", 0)
    monkeypatch.setattr("serp.planning.lookahead._CORES", 3)
    model = MODELS[number]
    states, leaves = states_of(model, Random(number), 20), leaves_of(model, number)
    alone, together = Lookahead(model), Lookahead(model)
    alone.leaves = together.leaves = leaves
    with together.prefetch(list(states)):
        for state in states:
            found = together.forecast(state)
            assert found is together.forecast(state)
            assert bits(found) == bits(alone.forecast(state))
            assert together.followed == alone.followed
        together.leaves = None
        assert bits(together.forecast(states[0])) == bits(Lookahead(model).forecast(states[0]))
    assert together.forecast(states[0]) is not together.forecast(states[0])


@examples(300)
@given(st.sampled_from(MODELS), SETTINGS, st.integers(0, 10**6))
def test_what_is_checked_to_be_safe_is_what_the_plan_finds_safe(model, settings, seed):
    for state in states_of(model, Random(seed), 6):
        checked = Lookahead(model, settings).check_safety(state)
        planned = Lookahead(model, settings).forecast(state)
        free = free_of_risk(planned.flags)
        event(f"known: {checked is not None}")
        if checked is None:
            continue
        assert (checked.choice, checked.bound) == (-1, Bound.SAFETY)
        np.testing.assert_array_equal(checked.flags, planned.flags)
        np.testing.assert_array_equal(checked.reward, planned.reward)
        assert free.any()
        assert (checked.safe_steps[free] == SAFE).all()
        assert (planned.safe_steps[free] == SAFE).all()
        assert not (checked.safe_steps[~free] == SAFE).any()


def ways_on(model, state, horizon, accepted):
    """How many actions begin a way that holds one, then another, without risk to the horizon."""

    def follow(state, action, periods):
        states = [state]
        while len(states) <= periods:
            (*after, _), flags = model.transition(states[-1], action)
            if not flags & APPLICABLE or step_risk(flags, accepted) > 0.0:
                return states, False
            states.append(after)
            if flags & TERMINAL:
                break
        return states, True

    def goes_on(action):
        states, safe = follow(state, action, horizon)
        return safe or any(
            follow(at, other, horizon - held)[1]
            for held, at in enumerate(states[1:], 1)
            for other in set(actions) - {action}
        )

    actions = range(len(model.actions))
    return sum(map(goes_on, actions))


def test_who_looks_farther_takes_what_leaves_enough_ways_on():
    met = Counter()
    for seed in range(150):
        random = Random(seed)
        model = random.choice(MODELS)
        settings = PlannerSettings(depth=random.randint(1, 2), accepted_risk=0.02)
        near, far = Lookahead(model, settings), Lookahead(model, settings)
        far.farther = True
        for state in states_of(model, random, 4):
            before, after = near.forecast(state), far.forecast(state)
            ways = {}
            for action in np.flatnonzero(before.safe_steps == SAFE).tolist():
                (*reached, _), flags = model.transition(state.tolist(), action)
                found = ways_on(model, reached, 4 * settings.depth, settings.accepted_risk)
                ways[action] = 2 if flags & TERMINAL else min(2, found)
            enough = [k for k, count in ways.items() if count == max(ways.values())]
            assert np.flatnonzero(after.safe_steps == SAFE).tolist() == enough
            lost = [k for k in ways if k not in enough]
            assert (after.safe_steps[lost] == before.depth).all()
            if before.choice in lost:
                assert after.choice == max(enough, key=lambda k: (before.value[k], -k))
            met["lost"] += bool(lost)
            met["turned"] += before.choice != after.choice
            checked = far.check_safety(state)
            if checked is not None and checked.bound is Bound.SAFETY:
                assert ((checked.safe_steps == SAFE) == (after.safe_steps == SAFE)).all()
                met["checked"] += 1
    assert len(met) == 3 and min(met.values()) >= 5, met


def test_ways_on_are_followed_within_the_budget_of_edges():
    """All is lost in the end, so that all ways are tried."""
    actions = "".join(f"(:action a{k} :effect (and (increase (t) 1)))" for k in range(6))
    model = load(
        f"(define (domain d) (:predicates (unsafe)) (:functions (t)) {actions}"
        " (:event end :precondition (>= (t) 11) :effect (and (unsafe))))"
    )
    for edges, least in ((10**6, 1_000), (100, 100)):
        core = _core.Lookahead(model.core, 3, 0.9, 0.0, 1_000, edges)
        core.farther = True
        _, followed = core.check_safety(np.zeros(1))
        assert least < followed < max(200, edges)


# Leaves that are worth something -----------------------------------------------------------------


def leaves_of(model, seed, size=1.0):
    """Values of all states, from those of random cells; the larger `size`, the louder."""
    random, width = np.random.default_rng(seed), len(model.fluents)
    states = np.array(states_of(model, Random(seed), 40)).reshape(-1, width)
    low, span = states.min(axis=0), np.ptp(states, axis=0)
    unit = np.divide(1.0, span, out=np.zeros(width), where=span > 0.0)
    cells = np.floor((states - low) * 8.0 * unit)
    _, first = np.unique(cells, axis=0, return_index=True)
    values = size * random.standard_normal(len(first) + 1)
    return _core.CellValues(low, 8.0 * unit, unit, states[first].ravel(), values)


@examples(50)
@given(st.sampled_from(MODELS[:WORLDS]), SETTINGS, st.integers(0, 10**6))
def test_every_first_action_is_worth_what_it_earns_and_where_it_ends(model, settings, other):
    settings = settings.replace(depth=min(settings.depth, 3))
    leaves, lookahead = leaves_of(model, other), Lookahead(model, settings)
    lookahead.leaves = leaves
    for state in states_of(model, Random(other), 2):
        forecast = lookahead.forecast(state)
        reference = Reference(model, settings, lambda s: leaves.at(np.array(s)))
        layers, bound = reference.layers(as_state(state))
        assert (forecast.depth, forecast.bound) == (layers, bound)
        if bound is not Bound.DEPTH:  # where there is no room, leaves are worth nothing
            reference = replace(reference, leaf=None)
        arcs = reference.arcs(as_state(state))
        for path in reference.counted([reference.along(arc, layers - 1) for arc in arcs]):
            action = path.arcs[0].action
            assert forecast.value[action] == pytest.approx(path.value, rel=1e-9, abs=1e-9)
            assert forecast.safe_steps[action] == path.steps


def test_leaves_decide_among_equals_and_are_never_worth_a_risk():
    """How long, and with which risk, an action is safe does not depend on leaves."""
    met = Counter()

    @examples(160)
    @given(
        st.sampled_from(MODELS), SETTINGS, st.integers(0, 10**6), st.sampled_from((1e-6, 1.0, 1e9))
    )
    def holds(model, settings, other, size):
        plain, valued = Lookahead(model, settings), Lookahead(model, settings)
        for state in states_of(model, Random(other), 6):
            valued.leaves = leaves_of(model, other, size)
            before, after = plain.forecast(state), valued.forecast(state)
            for column in ("path_risk", "safe_steps", "flags", "reward"):
                assert getattr(after, column).tobytes() == getattr(before, column).tobytes()
            assert (after.depth, after.bound) == (before.depth, before.bound)
            assert (after.choice >= 0) == (before.choice >= 0)
            chosen = after.choice
            if chosen >= 0:
                ranks = [rank_of(int(flags)) for flags in after.flags]
                best = after.applicable & (np.array(ranks) == ranks[chosen])
                assert ranks[chosen] == np.array(ranks)[after.applicable].min()
                assert after.path_risk[chosen] == after.path_risk[best].min()
                met["something worse is worth more"] += after.value.max() > after.value[chosen]
            met["leaves turn the choice"] += after.choice != before.choice
            met["indifferent"] += before.indifferent
            valued.leaves = None  # taken away, they leave no trace
            assert bits(valued.forecast(state)) == bits(before)

    holds()
    assert len(met) == 3
    assert min(met.values()) >= 10, met
