"""The adapted model: what it adds to the file, and what it never takes away."""

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.flags import APPLICABLE, UNSAFE
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.feature_groups import CURVED, FEATURES, FILE, FULL, LINEAR, RANGE, SMOOTH
from serp.model.transition_model import UNKNOWN
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.generated import random_states
from tests.generated.profile import examples
from tests.serp.model.learned import worlds
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import MILD, WILD, publish

SEEDS = (1, 4, 6)
"""Of generated domains."""


def model_of(name):
    if name == "edge":
        return worlds.edge()
    return worlds.generated(int(name)) if name.isdigit() else worlds.shipped(name)


MODELS = [*worlds.SHIPPED, "edge", *map(str, SEEDS)]


def states_and_actions(model, count, seed):
    random = Random(seed)
    states = random_states(random, model, count)
    return states, [random.randrange(len(model.actions)) for _ in range(count)]


def everything(model, states, actions):
    """Bits of what a model says of steps, of a batch and of single ones, flags included."""
    batch = model.step(states, actions)
    told = [np.asarray(column).tobytes() for column in batch]
    for state, action in zip(states, actions, strict=True):
        out, flags = model.transition(state.tolist(), action)
        told += [np.array(out).tobytes() if flags & APPLICABLE else None, flags]
    return told


@pytest.mark.parametrize("name", MODELS)
def test_with_nothing_learned_it_is_the_written_model(name):
    written = model_of(name)
    model = AdaptedModel(written)
    assert model.as_written
    states, actions = states_and_actions(written, 60, 3)
    assert everything(model, states, actions) == everything(written, states, actions)
    for state, action in zip(states[:5], actions, strict=False):
        assert model.trace(state, action) == written.trace(state, action)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("numbers", [MILD, WILD, None], ids=["mild", "wild", "counts"])
def test_single_steps_batches_and_traces_agree(name, numbers):
    model = AdaptedModel(model_of(name))
    publish(model, np.random.default_rng(7), numbers or MILD)
    if numbers is None:
        worlds.count(model, np.random.default_rng(7))
    states, actions = states_and_actions(model, 60, 4)
    batch = model.step(states, actions)
    for row, (state, action) in enumerate(zip(states, actions, strict=True)):
        single = model.step(state, action)
        for ours, theirs in zip(batch, single, strict=True):
            assert ours[row].tobytes() == np.asarray(theirs).tobytes()
        # A trace runs the effects one by one, in Python.
        _, flags = model.trace(state, action)
        if single.applicable:
            assert bool(flags & UNSAFE) == (single.risk > 0.0)


@given(name=st.sampled_from(MODELS), seed=st.integers(0, 2**32), wild=st.booleans())
@examples(80)
def test_what_the_file_flags_unsafe_stays_flagged_whatever_is_learned(name, seed, wild):
    written = model_of(name)
    model = AdaptedModel(written)
    rng = np.random.default_rng(seed)
    publish(model, rng, WILD if wild else MILD)
    states, actions = states_and_actions(written, 8, seed)
    flagged = np.zeros(len(states), dtype=bool)
    for k, (state, action) in enumerate(zip(states, actions, strict=True)):
        _, by_file = written.transition(state.tolist(), action)
        _, now = model.transition(state.tolist(), action)
        flagged[k] = bool(by_file & UNSAFE)
        assert now & UNSAFE >= by_file & UNSAFE
        assert model.trace(state, action)[1] & UNSAFE >= by_file & UNSAFE
    batch = model.step(states, actions)
    assert (batch.unsafe | ~batch.applicable)[flagged].all()
    assert np.isfinite(batch.state[batch.applicable]).all()
    assert np.isfinite(batch.reward[batch.applicable]).all()
    forecast = Lookahead(model, PlannerSettings(depth=1)).forecast(states[0])
    for action in range(len(written.actions)):
        _, by_file = written.transition(states[0].tolist(), action)
        assert forecast.flags[action] & UNSAFE >= by_file & UNSAFE


# What an adaptation adds -----------------------------------------------------------------------


@pytest.mark.parametrize("text", [worlds.PLANE, worlds.ICE], ids=["plane", "ice"])
@pytest.mark.parametrize("seed", range(10))
def test_the_residual_is_added_to_what_the_file_says_and_far_from_the_data_the_linear_one(
    text, seed
):
    model, rng = AdaptedModel(from_text(text).model.replace(dt=0.5)), np.random.default_rng(seed)
    publish(model, rng, MILD)
    for _ in range(20):
        state, action = worlds.any_state(model, rng), int(rng.integers(2))
        expected, size = model.written.step(state, action).state, 1.0
        for group in model.feature_groups[action]:
            part, inputs = model.regressions[group.key[1:]], state[list(group.inputs)]
            head = model.shared[group.key].head
            away = (inputs - part.centre) * part.shrink
            features = np.cos(part.phase + away @ part.frequency)
            far = (abs(away) > RANGE).any() and model.uncertainty(state)[action] >= UNKNOWN
            kinds = np.minimum(part.kinds, LINEAR if far else FULL)
            for t, (target, kind) in enumerate(zip(group.targets, kinds, strict=True)):
                if kind != FILE:
                    expected[target] += part.linear[head, int(kind) - 1, t] @ [1.0, *away]
                used = {CURVED: SMOOTH, FULL: FEATURES}.get(int(kind), 0)
                if used:
                    weights = part.amplitude[int(kind) - CURVED, t, :used]
                    expected[target] += weights @ features[:used]
                    size += np.abs(weights).sum()
        found = model.step(state, action).state
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3 * (size - 1) + 1e-9)


def test_events_look_at_the_corrected_state():
    model = AdaptedModel(worlds.edge())
    state = model.state({"x": 0.5, "y": 0.0, "wet": False})
    assert not model.step(state, "left").unsafe
    shift(model, "left", "x", -3.0)
    outcome = model.step(state, "left")
    assert outcome.terminal
    # The file does not flag it, and so it is no more than a risk, if a certain one.
    assert not outcome.unsafe and outcome.risk == 1.0
    assert outcome.reward == pytest.approx(-5.1)
    sites, flags = model.trace(state, model.action_index("left"))
    assert flags & UNSAFE
    assert "pit" in {site.schema.schema for site in sites if site.schema is not None}


def shift(model, action, fluent, by):
    """Let an action change a fluent by so much more than the file says."""
    column = next(f.index for f in model.fluents if f.name == fluent)
    for group in model.feature_groups[model.action_index(action)]:
        if column in group.targets:
            part, target = model.regressions[group.key[1:]], group.targets.index(column)
            kinds = part.kinds
            kinds[target] = LINEAR
            part.kinds = kinds
            part.linear[model.shared[group.key].head, 0, target, 0] = by
    assert not model.as_written


def test_with_other_parameters_or_period_it_is_as_written():
    model = AdaptedModel(from_text(worlds.PLANE).model)
    publish(model, np.random.default_rng(0), MILD)
    states, actions = states_and_actions(model, 20, 0)
    expected = everything(model.written.replace(dt=0.1), states, actions)
    assert everything(model.replace(dt=0.1), states, actions) == expected
