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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("middle", "unit"),
    [(0.0, 1.0), (1e4, 1.0), (-2e3, np.array([1e-3, 1.0, 1e3]))],
    ids=["around zero", "far from it", "in units of their own"],
)
def test_a_smooth_function_is_met_in_states_that_nobody_saw(
    seed: int, middle: float, unit: float | Vector
) -> None:
    seen, unseen = states_of(0, 1_000), states_of(1, 300)
    value = fitted(middle + unit * seen, smooth(seen), seed)
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
@given(
    seed=st.integers(0, 5),
    state=st.lists(st.floats() | st.floats(-1e6, 1e6), min_size=F, max_size=F),
)
def test_it_never_leaves_the_range_of_what_it_was_fitted_to(seed: int, state: list[float]) -> None:
    states = states_of(seed, 40)
    values = 10.0 * smooth(states)
    found = fitted(states, values, seed).of(np.array(state))
    assert values.min() <= found <= values.max()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("fluent", range(F))
def test_what_is_no_state_is_worth_the_least(wrong: float, fluent: int) -> None:
    states = states_of(0, 40)
    states[:, 1] = 2.0  # rests
    values = smooth(states)
    state = states[3].copy()
    state[fluent] = wrong
    assert fitted(states, values).of(state) == values.min()


def test_beyond_the_range_it_is_cut_not_wrong_in_between() -> None:
    """A line goes on; its estimate ends where the values did."""
    line = np.linspace(-1.0, 1.0, 200)[:, np.newaxis]
    value = fitted(line, 3.0 * line[:, 0])
    found = [value.of(np.array([x])) for x in (-0.8, -0.4, 0.0, 0.4, 0.8)]
    assert found == pytest.approx([-2.4, -1.2, 0.0, 1.2, 2.4], abs=0.1)
    assert (value.of(np.array([1.3])), value.of(np.array([-1.3]))) == (3.0, -3.0)


def test_one_sample_says_the_same_of_every_state() -> None:
    value = fitted(np.array([[1.0, -2.0, 3.0]]), np.array([4.5]))
    assert [value.of(state) for state in states_of(0, 20)] == [4.5] * 20


def test_values_that_are_all_alike_stay_so() -> None:
    value = fitted(states_of(0, 50), np.full(50, -1.25))
    assert [value.of(state) for state in states_of(1, 20)] == [-1.25] * 20


def test_states_without_fluents_are_worth_the_mean() -> None:
    value = fitted(np.zeros((4, 0)), np.array([1.0, 2.0, 3.0, 6.0]))
    assert value.of(np.zeros(0)) == pytest.approx(3.0)


def test_equal_seeds_give_equal_bits_and_others_give_others() -> None:
    states = states_of(0, 100)
    packed = [fitted(states, smooth(states), seed).packed.tobytes() for seed in (1, 1, 2)]
    assert packed[0] == packed[1]
    assert packed[0] != packed[2]


def test_a_fit_owes_nothing_to_those_before() -> None:
    states, others = states_of(0, 100), 5.0 + states_of(1, 30)
    value = fitted(others, -smooth(others))
    value.fit(states, smooth(states))
    assert value.packed.tobytes() == fitted(states, smooth(states)).packed.tobytes()


def test_what_was_packed_is_restored_whatever_the_seed() -> None:
    states = states_of(0, 100)
    value = fitted(states, smooth(states))
    other = LeafValue(F, np.random.SeedSequence(9))
    packed = value.packed.copy()
    other.restore(packed)
    packed[:] = np.nan  # it is the other's own
    assert other.fitted
    assert other.packed.tobytes() == value.packed.tobytes()
    unseen = states_of(1, 50)
    assert [other.of(state) for state in unseen] == [value.of(state) for state in unseen]
    other.restore(np.zeros(0))
    assert not other.fitted


def test_what_does_not_fit_is_not_restored() -> None:
    value = fitted(states_of(0, 50), smooth(states_of(0, 50)))
    before = value.packed.tobytes()
    wider = fitted(np.zeros((5, F + 1)), np.arange(5.0)).packed
    fewer = value.packed.copy()
    fewer[0] -= 1.0
    for packed in (wider, value.packed[:-1], value.packed[:, np.newaxis], np.zeros(1), fewer):
        with pytest.raises(ValueError, match="instead of"):
            value.restore(packed)
    assert value.packed.tobytes() == before


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["state", "value"])
def test_what_is_no_number_leaves_the_estimate_as_it_was(wrong: float, where: str) -> None:
    states = states_of(0, 50)
    values = smooth(states)
    value = fitted(states, values)
    before = value.packed.tobytes()
    if where == "state":
        states[7, 2] = wrong
    else:
        values[7] = wrong
    value.fit(states, values)
    assert value.packed.tobytes() == before
    assert not fitted(states, values).fitted


def test_a_regression_without_a_solution_leaves_the_estimate_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    states = states_of(0, 50)
    value = fitted(states, smooth(states))
    before = value.packed.tobytes()
    monkeypatch.setattr("serp.planning.leaf_value._RIDGE", 0.0)
    value.fit(np.ones((4, F)), np.arange(4.0))  # no feature differs: singular without a ridge
    assert value.packed.tobytes() == before
