"""Re-estimating parameters."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.learned.parameter_fit import estimate_parameters, parameter_dependencies
from tests.generated.profile import examples
from tests.serp.model.learned.rolls import from_text, imagined
from tests.worlds import text

CARTS = text("carts")


def carts_states(number, rng):
    model = from_text(CARTS).model
    states = rng.uniform(-2.0, 2.0, size=(number, len(model.fluents)))
    numeric = np.array([fluent.numeric for fluent in model.fluents])
    return np.where(numeric, states, states > 0)


def positions(model, schema):
    """Positions in θ of the parameters of a schema."""
    found = parameter_dependencies(model.ground)
    return [d.parameter.index for d in found if d.schema == schema]


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=5, max_size=5),
    st.sampled_from([0.0, 0.01, 0.1]),
    st.integers(0, 1_000),
)
@examples(10)
def test_other_parameters_are_recovered_within_their_errors(values, noise, seed):
    model = from_text(CARTS).model.replace(dt=0.1)
    theta = model.theta.copy()
    changed = [
        i.parameter.index for i in parameter_dependencies(model.ground) if i.symbol != "heat"
    ]
    theta[changed] = values[: len(changed)]
    rng = np.random.default_rng(seed)
    seen = imagined(model.replace(theta=theta), carts_states(400, rng), rng, noise)
    estimate, errors = estimate_parameters(model, seen.states, seen.actions, seen.next_states)
    assert np.isfinite(errors[changed]).all()
    gap = np.abs(estimate - theta)[changed]
    assert (gap <= 5.0 * errors[changed] + 1e-6).all()
    assert (errors[changed] <= 1.0 * noise + 1e-6).all()


def test_of_a_product_of_parameters_one_moves():
    model = from_text(CARTS).model.replace(dt=0.1)
    theta = model.theta.copy()
    product = positions(model, "push")[-2:]
    theta[product[0]] *= 2.0
    rng = np.random.default_rng(0)
    seen = imagined(model.replace(theta=theta), carts_states(400, rng), rng)
    estimate, errors = estimate_parameters(model, seen.states, seen.actions, seen.next_states)
    assert np.isfinite(errors[product]).sum() == 1
    assert estimate[product].prod() == pytest.approx(theta[product].prod(), rel=1e-4)


def test_what_was_never_seen_stays_as_written():
    model = from_text(CARTS).model.replace(dt=0.1)
    rng = np.random.default_rng(0)
    seen = imagined(model, carts_states(300, rng), rng)
    pushed = seen.actions < 2
    rows = (seen.states[pushed], seen.actions[pushed], seen.next_states[pushed])
    estimate, errors = estimate_parameters(model.replace(theta=model.theta + 1.0), *rows)
    (stop,) = positions(model, "stop")
    assert estimate[stop] == 0.125
    assert errors[stop] == np.inf
    rest, values = ~np.isfinite(errors), np.array([p.value for p in model.parameters])
    assert (estimate[rest] == values[rest]).all()
    none, unknown = estimate_parameters(model, *(r[:0] for r in rows))
    assert (none == values).all()
    assert np.isinf(unknown).all()


def test_numbers_that_jump_by_chance_are_no_rates():
    text = CARTS.replace("(assign (v ?c) 0.125)", "(increase (v ?c) 1)").replace("0.5", "1")
    model = from_text(text).model
    rng = np.random.default_rng(0)
    states = np.zeros((400, len(model.fluents)))
    columns = [f.index for f in model.fluents if f.symbol == "v"]
    states[:, columns] = rng.integers(-3, 4, size=(400, len(columns)))
    actions = np.zeros(400, dtype=np.int64)
    after = states.copy()
    after[:, columns[0]] += rng.integers(0, 2, size=400)
    estimate, errors = estimate_parameters(model, states, actions, after)
    push = positions(model, "push")[0]
    assert errors[push] == np.inf
    after[:, columns[0]] = states[:, columns[0]] + 2.0
    estimate, errors = estimate_parameters(model, states, actions, after)
    assert estimate[push] == pytest.approx(2.0)


WALL = """(define (domain wall)
  (:requirements :numeric-fluents)
  (:functions (gap))
  (:action walk :parameters () :precondition (and) :effect (and (decrease (gap) 0.1)))
  (:event touch :parameters () :precondition (and (< (gap) 0.2))
    :effect (and (assign (gap) 0.2))))"""


@pytest.mark.parametrize("written", ["0.05", "0.1", "0.3", "50"])
def test_a_wall_hides_neither_too_much_nor_too_little(written):
    rng = np.random.default_rng(0)
    states = rng.uniform(0.2, 1.0, size=(300, 1))
    seen = imagined(from_text(WALL).model, states, rng)
    model = from_text(WALL.replace("0.1)", f"{written})")).model
    estimate, errors = estimate_parameters(model, seen.states, seen.actions, seen.next_states)
    (walk,) = positions(model, "walk")
    assert np.isfinite(errors[walk])
    assert estimate[walk] == pytest.approx(0.1, abs=1e-6)
