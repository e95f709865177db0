"""The array form decides exactly as the planning graph does."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from random import Random
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.forecast import Forecast
from serp.planning.leaf_value import LeafValue
from serp.planning.limits import Bound
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings
from tests.generated import PLANNABLE, generate, random_states
from tests.generated.profile import examples
from tests.serp.planning.reference import Reference, as_state
from tests.serp.planning.worlds import WORLDS, load, states_of, world

PLANNERS = st.builds(
    PlannerSettings,
    depth=st.integers(1, 4),
    repeat=st.integers(1, 3),
    discount=st.sampled_from((1.0, 0.99, 0.9, 0.5)),
    max_nodes=st.sampled_from((1, 2, 3, 5, 8, 20, 60, 10_000)),
)


def graph_forecast(model: TransitionModel, settings: PlannerSettings, state: Vector) -> Forecast:
    planner = MonitorReplanner(
        model,
        depth=settings.depth,
        discount=settings.discount,
        repeat=settings.repeat,
        max_nodes=settings.max_nodes,
        accepted_risk=settings.accepted_risk,
    )
    return planner.plan(state).forecast


def bits(forecast: Forecast) -> list[object]:
    """All fields, arrays as their bytes: equal bits, -0.0 and NaN included."""
    return [
        (f.dtype, f.shape, f.tobytes()) if isinstance(f, np.ndarray) else int(f) for f in forecast
    ]


def assert_all_forms_agree(
    model: TransitionModel, settings: PlannerSettings, states: Vector
) -> list[Forecast]:
    lookahead = Lookahead(model, settings)
    singles = [lookahead.forecast(state) for state in states]
    for state, single in zip(states, singles, strict=True):
        assert bits(single) == bits(graph_forecast(model, settings, state))
        assert type(single.choice) is int and type(single.bound) is Bound
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.model.program.MAX_NATIVE_SIZE", -1)
        assert not model.compiles
        for state, single in zip(states, singles, strict=True):
            assert bits(single) == bits(graph_forecast(model, settings, state))
    return singles


@examples(120)
@given(st.integers(0, WORLDS - 1), PLANNERS, st.integers(0, 10**6))
def test_lookahead_graph_and_interpreter_agree_bit_for_bit(
    seed: int, settings: PlannerSettings, states_seed: int
) -> None:
    model = world(seed)
    assert_all_forms_agree(model, settings, states_of(model, Random(states_seed), 3))


@examples(24)
@given(st.sampled_from((0, 1, 2, 4, 10, 11)), PLANNERS)
def test_they_agree_on_domains_with_all_that_the_language_has(
    seed: int, settings: PlannerSettings
) -> None:
    random = Random(seed)
    model = generate(random, PLANNABLE).model
    assert_all_forms_agree(model, settings, random_states(random, model, 6))


@examples(40)
@given(st.integers(0, WORLDS - 1), PLANNERS, st.integers(1, 60))
def test_they_agree_on_where_memory_ends(seed: int, settings: PlannerSettings, edges: int) -> None:
    model = world(seed)
    states = states_of(model, Random(seed), 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.planning.limits.MAX_NUMBERS", edges * (len(model.fluents) + 1))
        reference = Reference(model, settings)
        for state, forecast in zip(
            states, assert_all_forms_agree(model, settings, states), strict=True
        ):
            assert reference.layers(as_state(state)) == (forecast.depth, forecast.bound)


RISKS = """
(define (domain risks)
  (:requirements :strips :numeric-fluents :conditional-effects)
  (:predicates (unsafe) (terminal))
  (:functions (x) (y) (reward))
  (:action walk :parameters () :precondition (and (< (x) 3))
    :effect (and (increase (x) 1.3) (increase (reward) (y))))
  (:action rest :parameters () :precondition (and (< (x) 3))
    :effect (and (increase (y) 0.1)))
  (:action risk :parameters () :precondition (and)
    :effect (and (unsafe) (increase (x) 0.7) (increase (y) (x)) (increase (reward) (x))))
  (:action leap :parameters () :precondition (and)
    :effect (and (when (and (> (x) 1)) (unsafe)) (increase (y) 0.3) (decrease (reward) 1)))
  (:event stop :parameters () :precondition (and (> (y) 6)) :effect (and (terminal))))
"""


@pytest.mark.parametrize("depth", [3, 5])
@pytest.mark.parametrize("repeat", [1, 2])
def test_what_lies_behind_a_risk_counts_where_nothing_else_is_left(depth: int, repeat: int) -> None:
    grid = np.meshgrid(np.linspace(-1.0, 2.9, 7), [-0.5, 0.5, 3.0])
    states = np.stack(grid, axis=-1).reshape(-1, 2)
    assert_all_forms_agree(load(RISKS), PlannerSettings(depth=depth, repeat=repeat), states)


def test_the_examples_meet_every_bound_ties_and_danger() -> None:
    """What the two tests above vary does make a difference."""
    bounds, ties, unsafe_paths, longest = set(), 0, 0, set()
    for seed in range(WORLDS):
        model = world(seed)
        for max_nodes in (5, 60):
            lookahead = Lookahead(model, PlannerSettings(depth=4, max_nodes=max_nodes))
            for state in states_of(model, Random(seed), 40):
                forecast = lookahead.forecast(state)
                bounds.add(forecast.bound)
                values = forecast.value[forecast.applicable]
                ties += len(values) != len(set(values.tolist()))
                unsafe_paths += forecast.choice >= 0 and not forecast.safe
                longest.update(forecast.safe_steps.tolist())
    assert bounds == {Bound.DEPTH, Bound.NODES, Bound.EXHAUSTED}
    assert ties > 50
    assert unsafe_paths > 50
    assert longest >= {-1, 0, 1, 2, 3}


def test_positive_and_negative_zero_are_one_state() -> None:
    """One node a layer, so that four nodes are enough for depth 4."""
    model = load(
        "(define (domain zeros) (:functions (x) (reward))"
        " (:action plus :parameters () :precondition (and) :effect (and (scale-up (x) 1)))"
        " (:action minus :parameters () :precondition (and) :effect (and (scale-up (x) -1))))"
    )
    settings = PlannerSettings(depth=4, max_nodes=4)
    (forecast,) = assert_all_forms_agree(model, settings, np.zeros((1, 1)))
    assert (forecast.depth, forecast.bound) == (4, Bound.DEPTH)


@pytest.mark.parametrize("shape", [(), (1,), (2, 1), (17,)])
def test_a_state_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    model = world(5)
    with pytest.raises(StateError, match=f"{len(model.fluents)} numbers"):
        Lookahead(model).forecast(np.zeros(shape))


def test_states_of_another_dtype_or_layout_are_read_right() -> None:
    model = world(5)
    state = states_of(model, Random(3), 1)[0]
    lookahead = Lookahead(model)
    spread = np.repeat(state, 2)[::2]
    assert not spread.flags.c_contiguous
    assert bits(lookahead.forecast(spread)) == bits(lookahead.forecast(state))
    small = state.astype(np.float32)  # halves are exact in float32
    assert bits(lookahead.forecast(small)) == bits(lookahead.forecast(state))


def test_memory_is_bounded_whatever_the_depth() -> None:
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
    Lookahead(model).forecast(np.ones(1))  # what is compiled stays out of the measurement
    tracemalloc.start()
    try:
        forecast = Lookahead(model, PlannerSettings(depth=60, max_nodes=20_000)).forecast(
            np.ones(1)
        )
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert forecast.bound is Bound.NODES
    assert forecast.depth == 7  # 1 + 5 + ... + 5^6 nodes; the next layer has 5^7
    assert peak < 20_000 * 5 * 40 + 20_000 * 60


NOTHING = np.zeros(0)

# Leaves that are worth something -----------------------------------------------------------------


def worth(model: TransitionModel, seed: int, size: float = 1.0) -> LeafValue:
    """Values of all states, fitted to random ones of some; the larger `size`, the louder."""
    random = np.random.default_rng(seed)
    value = LeafValue(len(model.fluents), np.random.SeedSequence(seed))
    value.fit(states_of(model, Random(seed), 40), size * random.standard_normal(40))
    return value


def with_leaves(
    model: TransitionModel,
    settings: PlannerSettings,
    mode: Literal["never", "indifferent", "always"],
    leaves: Vector,
) -> Lookahead:
    lookahead = Lookahead(model, settings.replace(leaf_value=mode))
    lookahead.leaves = leaves
    return lookahead


def best_of(value: Vector, safe_steps: Vector) -> int:
    """The choice by the book: safe for longest, then worth most, then first."""
    applicable = [a for a in range(len(value)) if safe_steps[a] >= 0]
    return max(applicable, key=lambda a: (safe_steps[a], value[a], -a), default=-1)


@examples(50)
@given(st.integers(0, WORLDS - 1), PLANNERS, st.integers(0, 10**6))
def test_every_first_action_is_worth_what_it_earns_and_where_it_ends(
    seed: int, settings: PlannerSettings, other: int
) -> None:
    model, settings = world(seed), settings.replace(depth=min(settings.depth, 3))
    value = worth(model, other)
    states = states_of(model, Random(other), 2)
    lookahead = with_leaves(model, settings, "always", value.packed)
    singles = [lookahead.forecast(state) for state in states]
    for state, forecast in zip(states, singles, strict=True):
        reference = Reference(model, settings, lambda s: value.of(np.array(s)))
        layers, bound = reference.layers(as_state(state))
        assert (forecast.depth, forecast.bound) == (layers, bound)
        if bound is not Bound.DEPTH:  # where there is no room, leaves are worth nothing
            reference = replace(reference, leaf=None)
        for action in range(len(model.actions)):
            arc = reference.arc(as_state(state), action)
            if arc is None:
                assert (forecast.value[action], forecast.safe_steps[action]) == (-np.inf, -1)
                continue
            path = reference.along(arc, layers - 1)
            assert forecast.value[action] == pytest.approx(path.value, rel=1e-9, abs=1e-9)
            assert forecast.safe_steps[action] == path.steps
        assert forecast.choice == best_of(forecast.value, forecast.safe_steps)


def wherever() -> st.SearchStrategy[tuple[int, PlannerSettings, int, float]]:
    """A world, settings, a seed, and how loud its leaves are."""
    return st.tuples(
        st.integers(0, WORLDS - 1),
        PLANNERS,
        st.integers(0, 10**6),
        st.sampled_from((1e-6, 1.0, 1e9)),
    )


@examples(100)
@given(wherever())
def test_leaves_decide_among_equals_and_are_never_worth_a_risk(
    drawn: tuple[int, PlannerSettings, int, float],
) -> None:
    """For how long an action is safe does not depend on leaves, and it comes before all values."""
    seed, settings, other, size = drawn
    model = world(seed)
    leaves = worth(model, other, size).packed
    plain = Lookahead(model, settings)
    always = with_leaves(model, settings, "always", leaves)
    asked = with_leaves(model, settings, "indifferent", leaves)
    for state in states_of(model, Random(other), 6):
        before, after = plain.forecast(state), always.forecast(state)
        assert bits(asked.forecast(state)) == bits(after if before.indifferent else before)
        for column in ("path_risk", "safe_steps", "flags", "reward"):
            assert getattr(after, column).tobytes() == getattr(before, column).tobytes()
        assert (after.depth, after.bound) == (before.depth, before.bound)
        assert (after.choice >= 0) == (before.choice >= 0)
        if after.choice >= 0:
            assert after.safe_steps[after.choice] == before.safe_steps.max()


@pytest.mark.parametrize("mode", ["never", "indifferent", "always"])
def test_without_leaves_and_where_they_are_not_asked_for_all_bits_are_as_ever(
    mode: Literal["never", "indifferent", "always"],
) -> None:
    settings = PlannerSettings(depth=3)
    for seed in range(WORLDS):
        model = world(seed)
        states = states_of(model, Random(seed), 10)
        plain, other = Lookahead(model, settings), with_leaves(model, settings, mode, NOTHING)
        expected = [bits(plain.forecast(state)) for state in states]
        assert [bits(other.forecast(state)) for state in states] == expected
        other.leaves = worth(model, seed).packed
        with_them = [bits(other.forecast(state)) for state in states]
        assert mode != "never" or with_them == expected
        other.leaves = NOTHING  # taken away again, they leave no trace
        assert [bits(other.forecast(state)) for state in states] == expected


def test_the_examples_meet_indifference_risks_and_choices_that_leaves_turn() -> None:
    """What the tests above vary does make a difference."""
    turned, indifferent, risky, crowded, ends = 0, 0, 0, 0, 0
    for seed in range(WORLDS):
        model = world(seed)
        leaves = worth(model, seed).packed
        for max_nodes in (5, 10_000):
            settings = PlannerSettings(depth=3, max_nodes=max_nodes)
            plain = Lookahead(model, settings)
            always = with_leaves(model, settings, "always", leaves)
            asked = with_leaves(model, settings, "indifferent", leaves)
            for state in states_of(model, Random(seed), 100):
                before, after = plain.forecast(state), always.forecast(state)
                indifferent += before.indifferent
                turned += asked.forecast(state).choice != before.choice
                applicable = before.safe_steps[before.applicable]
                risky += len(set(applicable.tolist())) > 1
                if after.choice >= 0 and after.value.max() > after.value[after.choice]:
                    crowded += 1  # something unsafe is worth more
                ends += bool(before.terminal.any())
    assert min(turned, indifferent, risky, crowded, ends) >= 20
