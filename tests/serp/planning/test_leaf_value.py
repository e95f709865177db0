"""Values of states, learned from some: right in between, never beyond what was seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.transition_model import Vector
from serp.planning.leaf_value import LeafValue
from tests.generated.profile import examples

F = 3


def states_of(seed: int, count: int) -> Vector:
    return np.random.default_rng(seed).standard_normal((count, F))


def smooth(states: Vector) -> Vector:
    """What all fluents have a part in, also together."""
    x, y, z = states.T
    values: Vector = np.tanh(x) + 0.5 * np.sin(y) * z + 0.3 * x
    return values


def fitted(states: Vector, values: Vector, seed: int = 0) -> LeafValue:
    value = LeafValue(states.shape[1], np.random.SeedSequence(seed))
    value.fit(states, values)
    return value


def explained(value: LeafValue, states: Vector, truth: Vector) -> float:
    found = np.array([value.of(state) for state in states])
    return float(1.0 - ((found - truth) ** 2).mean() / truth.var())


@pytest.mark.parametrize(
    ("middle", "unit"),
    [(0.0, 1.0), (1e4, 1.0), (-2e3, np.array([1e-3, 1.0, 1e3]))],
    ids=["around zero", "far from it", "in units of their own"],
)
def test_a_smooth_function_is_met_in_states_that_nobody_saw(
    middle: float, unit: float | Vector
) -> None:
    seen, unseen = states_of(0, 1_000), states_of(1, 300)
    value = fitted(middle + unit * seen, smooth(seen))
    assert explained(value, middle + unit * unseen, smooth(unseen)) > 0.98


@pytest.mark.parametrize("wild", [1e6, 1e30])
def test_a_few_wild_states_do_not_make_the_others_look_alike(wild: float) -> None:
    seen, unseen = states_of(0, 1_000), states_of(1, 300)
    values = smooth(seen)
    seen[::100] *= wild
    assert explained(fitted(seen, values), unseen, smooth(unseen)) > 0.9


def test_a_fluent_that_seldom_moves_counts_where_it_does() -> None:
    """It rests in more than nine states of ten."""
    seen = states_of(0, 1_000)
    seen[:, 1] = np.arange(1_000) % 25 == 0
    value = fitted(seen, 3.0 * seen[:, 1])
    found = [value.of(np.array([0.0, moved, 0.0])) for moved in (0.0, 1.0)]
    assert found == pytest.approx([0.0, 3.0], abs=0.3)


@pytest.mark.parametrize("rest", [0.0, -7.0, 1e6])
def test_a_fluent_that_rests_has_no_part_in_it(rest: float) -> None:
    def with_rest(states: Vector, at: float) -> Vector:
        return np.insert(states, 1, at, axis=1)

    seen, unseen = states_of(0, 1_000), states_of(1, 300)
    value = fitted(with_rest(seen, rest), smooth(seen))
    assert explained(value, with_rest(unseen, rest), smooth(unseen)) > 0.98
    # Nobody knows what it does where it moves after all.
    for state in unseen[:20]:
        moved = [value.of(np.insert(state, 1, rest + by)) for by in (0.0, 1.0, -1e5)]
        assert moved == [moved[0]] * 3


@examples(150)
@given(state=st.lists(st.floats() | st.floats(-1e6, 1e6), min_size=F, max_size=F))
def test_it_never_leaves_the_range_of_what_it_was_fitted_to(state: list[float]) -> None:
    """And what is no state is worth the least, also in a fluent that rests."""
    states = states_of(0, 40)
    states[:, 1] = 2.0
    values = 10.0 * smooth(states)
    found = fitted(states, values).of(np.array(state))
    assert values.min() <= found <= values.max()
    assert np.isfinite(state).all() or found == values.min()


@pytest.mark.parametrize(
    ("states", "values", "mean"),
    [
        (np.array([[1.0, -2.0, 3.0]]), np.array([4.5]), 4.5),  # one sample
        (states_of(0, 50), np.full(50, -1.25), -1.25),  # values that are all alike
        (np.zeros((4, 0)), np.array([1.0, 2.0, 3.0, 6.0]), 3.0),  # states without fluents
    ],
)
def test_where_states_or_values_are_alike_all_are_worth_the_mean(
    states: Vector, values: Vector, mean: float
) -> None:
    value = fitted(states, values)
    for state in states_of(1, 20)[:, : states.shape[1]]:
        assert value.of(state) == pytest.approx(mean)


def test_a_fit_depends_on_the_seed_and_on_no_fit_before() -> None:
    states, others = states_of(0, 100), 5.0 + states_of(1, 30)
    packed = [fitted(states, smooth(states), seed).packed.tobytes() for seed in (1, 1, 2)]
    assert packed[0] == packed[1] != packed[2]
    value = fitted(others, -smooth(others), 1)
    value.fit(states, smooth(states))
    assert value.packed.tobytes() == packed[0]


def test_what_was_packed_is_restored_whatever_the_seed_if_it_fits() -> None:
    states = states_of(0, 50)
    value, other = fitted(states, smooth(states)), LeafValue(F, np.random.SeedSequence(9))
    packed = value.packed.copy()
    other.restore(packed)
    packed[:] = np.nan  # it is the other's own
    assert [other.of(state) for state in states] == [value.of(state) for state in states]
    before = value.packed.tobytes()
    wider = fitted(np.zeros((5, F + 1)), np.arange(5.0)).packed
    fewer = value.packed.copy()
    fewer[0] -= 1.0
    for wrong in (wider, value.packed[:-1], value.packed[:, np.newaxis], np.zeros(1), fewer):
        with pytest.raises(ValueError, match="instead of"):
            value.restore(wrong)
    assert value.packed.tobytes() == before
    other.restore(np.zeros(0))
    assert not other.fitted


def test_an_estimate_stays_where_there_is_no_better_one(monkeypatch: pytest.MonkeyPatch) -> None:
    states = states_of(0, 50)
    value = fitted(states, smooth(states))
    before = value.packed.tobytes()
    for wrong in (np.nan, np.inf, -np.inf):
        spoiled = states.copy()
        spoiled[7, 2] = wrong
        value.fit(spoiled, smooth(states))
        value.fit(states, np.append(smooth(states[1:]), wrong))
        assert value.packed.tobytes() == before
        assert not fitted(spoiled, smooth(states)).fitted
    monkeypatch.setattr("serp.planning.leaf_value._RIDGE", 0.0)
    value.fit(np.ones((4, F)), np.arange(4.0))  # no feature differs: singular without a ridge
    assert value.packed.tobytes() == before
