"""What is learned of one-step errors, seen in what the adapted model predicts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.generated.profile import examples
from tests.serp.model.learned.worlds import (
    FLEET,
    ICE,
    PLANE,
    adaptation,
    adapted,
    any_state,
    error,
    plus,
    teach,
)

PUSH, REST = 0, 1


def linear_world(state, action):
    """A spring with friction; the push works on it."""
    p, v = state
    return np.array([p + 0.12 * v, v + (0.3 if action == PUSH else 0.0) - 0.1 * p - 0.2 * v])


def pendulum(state, action):
    p, v = state
    return np.array([p + 0.1 * v, v + (0.3 if action == PUSH else 0.0) - 0.5 * np.sin(p)])


def as_written(state, action):
    return np.array([state[0] + 0.1 * state[1], state[1]])


def typical(of, world, draw=None):
    """`[F]` root mean squared error of the model in use, over both actions."""
    rng = np.random.default_rng(99)
    states = [any_state(of.model, rng) if draw is None else draw(rng) for _ in range(200)]
    errors = [error(of, state, a, world(state, a)) for state in states for a in (PUSH, REST)]
    return np.sqrt(np.square(errors).mean(axis=0))


def uncertainty(of, state):
    """How far the push is from the data."""
    return float(adapted(of).uncertainty(state)[PUSH])


def adapts_nothing(of):
    """Whether the model in use predicts the bits of the one written."""
    model = adapted(of)
    rng = np.random.default_rng(5)
    states = np.array([any_state(model, rng) for _ in range(50)])
    return all(
        model.step(states, action).state.tobytes()
        == model.written.step(states, action).state.tobytes()
        for action in range(len(model.actions))
    )


# What can be learned ---------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32))
@examples(8)
def test_a_linear_error_is_learned_exactly_from_few_samples(seed):
    rng = np.random.default_rng(seed)
    weights, constants = rng.normal(size=(2, 2)), rng.normal(size=(2, 2))

    def world(state, action):
        return as_written(state, action) + weights @ state + constants[action]

    of = adaptation(PLANE, seed=seed % 1000)
    teach(of, world, rng, 30)
    written = np.sqrt(np.square(weights @ [1.0, 1.0]).mean())
    assert (typical(of, world) < 1e-2 * max(1.0, written)).all()
    teach(of, world, rng, 200)
    assert (typical(of, world) < 1e-3).all()


def test_a_nonlinear_error_is_learned():
    of = adaptation(PLANE)
    teach(of, pendulum, np.random.default_rng(0), 600)
    assert typical(of, pendulum)[1] < 0.02
    assert typical(of, pendulum)[0] < 1e-6  # where the file is right it stays


@pytest.mark.parametrize("share", [0.5, 0.05])
def test_different_things_are_learned_by_predicates_however_seldom_they_hold(share):
    def world(state, action):
        icy, p, v = state
        push = (0.5 if action == PUSH else 0.0) * (0.2 if icy else 1.0)
        return np.array([icy, p, v + push - (0.0 if icy else 0.3 * v)])

    def draw(rng):
        return np.array([float(rng.random() < share), *rng.normal(size=2)])

    of = adaptation(ICE)
    teach(of, world, np.random.default_rng(0), int(150 / share), draw=draw)
    assert (typical(of, world) < 1e-2).all()


def test_what_is_learned_of_one_object_is_known_of_all_of_its_type():
    """Ada alone is driven: a metre, and a tenth of her place off her battery."""
    of = adaptation(FLEET)
    model = adapted(of)
    column = {fluent.name: fluent.index for fluent in model.fluents}

    def world(state, action):
        after = np.asarray(model.written.step(state, action).state)
        if model.actions[action].schema == "drive":
            (who,) = model.actions[action].arguments
            after[column[f"place {who}"]] += 1.3
            after[column[f"battery {who}"]] -= 0.1 * state[column[f"place {who}"]]
        return after

    rng = np.random.default_rng(0)
    teach(of, world, rng, 150, actions=(model.action_index("drive ada"),))
    for action in (model.action_index(f"drive {name}") for name in ("ada", "bob", "cid")):
        state = any_state(model, rng)
        assert (error(of, state, action, world(state, action)) < 0.01).all()


@pytest.mark.parametrize("world", [linear_world, pendulum])
@pytest.mark.parametrize("offset", [5e6, -1.7e9])
def test_how_far_from_0_a_fluent_is_makes_no_difference(world, offset):
    """A coordinate of a map, a time in seconds: what matters is how it varies."""
    errors = []
    for origin in (np.zeros(2), np.array([offset, 0.0])):
        of = adaptation(PLANE)

        def draw(rng, origin=origin):
            return origin + [0.1, 1.0] * rng.normal(size=2)

        def seen(state, action, origin=origin):
            return origin + world(state - origin, action)

        teach(of, seen, np.random.default_rng(0), 200, draw=draw)
        errors.append(typical(of, seen, draw))
    assert (errors[1] <= 2 * errors[0] + 4 * np.spacing(abs(offset))).all()
    assert errors[1][1] < 1e-2


def test_uncertainty_is_small_where_much_was_seen_and_large_where_nothing_was():
    of = adaptation(PLANE)
    assert uncertainty(of, np.zeros(2)) == 1.0
    rng = np.random.default_rng(0)
    teach(of, pendulum, rng, 600, draw=lambda rng: rng.uniform(-1.0, 1.0, size=2))
    near = [uncertainty(of, rng.uniform(-1.0, 1.0, size=2)) for _ in range(50)]
    far = [uncertainty(of, 6.0 * sign) for sign in (np.ones(2), -np.ones(2))]
    assert 0.0 <= np.mean(near) < 0.2 and max(near) < 0.4 < 0.9 < min(far) <= 1.0


# No regret -------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1e-12, 0.05])
def test_a_file_that_is_right_stays_in_charge(noise):
    for seed in range(3):
        of = adaptation(PLANE)
        rng = np.random.default_rng(seed)
        teach(of, lambda s, a: as_written(s, a) + noise * rng.normal(size=2), rng, 500)  # noqa: B023
        assert typical(of, as_written).max() <= 0.3 * noise
        if noise < 1e-6:
            assert adapts_nothing(of)


@given(seed=st.integers(0, 2**32), outliers=st.booleans())
@examples(8)
def test_whatever_happens_the_file_does_hardly_better(seed, outliers):
    """Random worlds, right ones and wrong ones, over all samples after the first few."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=(2, 2)) * rng.choice([0.0, 0.1, 1.0], size=(2, 1))
    bend, noise = rng.choice([0.0, 1.0]), rng.choice([0.0, 0.02])

    def world(state, action):
        off = weights @ state + bend * np.sin(3.0 * state) + noise * rng.normal(size=2)
        after = as_written(state, action) + off
        if outliers and rng.random() < 0.01:
            after[rng.integers(2)] += 1000.0 * rng.normal()
        return after

    of = adaptation(PLANE)
    errors = teach(of, world, rng, 400)[50:]
    states, actions = of.experience.states[50:], of.experience.actions[50:]
    written = adapted(of).written.step(states, actions).state
    by_file = np.abs(written - of.experience.next_states[50:])
    usual = by_file < 20.0  # leave the outliers themselves out
    for column in range(2):
        ours = errors[usual[:, column], column]
        assert ours.mean() <= 1.1 * by_file[usual[:, column], column].mean() + 1e-9


# What must not be believed ---------------------------------------------------------------------


@pytest.mark.parametrize("before", [0, 30, 100])
@pytest.mark.parametrize("worth", [np.nan, np.inf, -np.inf, 1e200, 1e308])
def test_what_is_no_number_teaches_nothing(before, worth):
    clean, spoilt = adaptation(PLANE), adaptation(PLANE)
    rngs = np.random.default_rng(3), np.random.default_rng(3)
    for of, rng in zip((clean, spoilt), rngs, strict=True):
        teach(of, linear_world, rng, before)
        for column in range(2):
            good, bad = np.array([0.3, -0.2]), np.array([0.3, -0.2])
            bad[column] = worth
            if of is spoilt:
                of.observe(good, PUSH, bad, False)
                of.observe(bad, PUSH, good, False)
                of.observe(bad, REST, bad, False)
        teach(of, linear_world, rng, 60)
    states = np.random.default_rng(4).normal(size=(50, 2))
    for action in (PUSH, REST):
        expected = clean.model.step(states, action).state
        assert spoilt.model.step(states, action).state.tobytes() == expected.tobytes()


@pytest.mark.parametrize("first", [linear_world, as_written])
@pytest.mark.parametrize(("before", "outliers"), [(400, 0.0), (1000, 0.0), (400, 0.01)])
def test_after_a_lasting_change_of_the_world_it_learns_again(first, before, outliers):
    """Whether the file was right before or something was learned beside it."""
    rng = np.random.default_rng(0)

    def other(state, action):
        return plus(first(state, action), 0.0, 0.5)

    def spoilt(world):
        def step(state, action):
            after = world(state, action)
            if rng.random() < outliers:
                after[rng.integers(2)] += 1000.0 * rng.normal()
            return after

        return step

    of = adaptation(PLANE)
    teach(of, first, rng, 40)
    teach(of, spoilt(first), rng, before)
    assert typical(of, first).max() < 1e-3
    teach(of, spoilt(other), rng, 400)
    assert typical(of, other).max() < 0.1
