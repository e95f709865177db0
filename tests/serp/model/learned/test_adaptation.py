"""What each env step teaches, what none does, and that a run continued equals one never stopped."""

import json

import numpy as np
import pytest

from serp.model.flags import going_on
from serp.runs import checkpoint
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import FLEET, GRID, ICE, PLANE, adaptation, adapted, any_state


def bits(saved):
    """What was saved, as it would be on disk."""
    arrays, meta = saved
    return (
        {name: a.tobytes() + str((a.dtype, a.shape)).encode() for name, a in arrays.items()},
        json.dumps(meta, sort_keys=True),
    )


def steps_of(of, count, seed):
    """Steps of a nonlinear world: predicates that flip, noise, outliers, unknown actions, ends.

    On `GRID` numbers are whole, so that outcomes are counted. At last the world changes.
    """
    whole = any(fluent.name == "row" for fluent in of.model.fluents)
    rng = np.random.default_rng(seed)
    numeric = np.array([fluent.numeric for fluent in of.model.fluents])
    mixing = np.random.default_rng(1).normal(size=(len(numeric), len(numeric)))
    steps = []
    for k in range(count):
        state, action = any_state(of.model, rng), int(rng.integers(-1, len(of.model.actions)))
        moved = state + 0.1 * np.sin(mixing @ state) + 0.05 * action + 0.5 * (k > 200)
        after = np.where(numeric, moved + 0.01 * rng.normal(size=len(state)), state)
        if whole:
            state, after = np.round(state), np.round(state) + rng.integers(2, size=len(state))
            after[~numeric] = state[~numeric]
        flips = ~numeric & (rng.random(len(state)) < 0.2)
        after[flips] = 1.0 - after[flips]
        if rng.random() < 0.02:
            after[rng.integers(len(state))] = rng.choice([1e3, np.nan, np.inf])
        steps.append((state, action, after, bool(rng.random() < 0.05)))
    return steps


def observe(of, steps):
    for step in steps:
        of.visit(step[1])
        of.observe(*step)


# Resuming --------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [PLANE, ICE, FLEET, GRID], ids=["plane", "ice", "fleet", "grid"])
@pytest.mark.parametrize("mode", ["off", "parameters", "residual", "full", "rewards"])
def test_resumed_equals_uninterrupted_bit_for_bit(tmp_path, text, mode):
    def new():
        return adaptation(text, mode, seed=5)

    whole = new()
    steps = steps_of(whole, 300, 2)
    observe(whole, steps)
    resumed = new()
    for number, (start, end) in enumerate([(0, 1), (1, 40), (40, 170), (170, 171), (171, 300)]):
        observe(resumed, steps[start:end])
        checkpoint.save(tmp_path / str(number), *resumed.state_dict())
        resumed = new()
        observe(resumed, steps[200 : 200 + 20 * number])  # is replaced
        resumed.load_state_dict(*checkpoint.load(tmp_path / str(number)))
    assert bits(resumed.state_dict()) == bits(whole.state_dict())
    states = np.array([any_state(whole.model, np.random.default_rng(k)) for k in range(20)])
    for action in range(len(whole.model.actions)):
        expected = whole.model.step(states, action)
        for ours, theirs in zip(resumed.model.step(states, action), expected, strict=True):
            assert np.asarray(ours).tobytes() == np.asarray(theirs).tobytes()
    assert resumed.visits.tolist() == whole.visits.tolist()


# What teaches ----------------------------------------------------------------------------------


def test_steps_that_end_an_episode_teach_no_residual_and_equal_seeds_give_equal_bits():
    def learned(seed, over):
        of = adaptation(PLANE, seed=seed)
        rng = np.random.default_rng(0)
        for _ in range(300):
            state = rng.normal(size=2)
            of.observe(state, int(rng.integers(2)), state + np.sin(state), over)
        return of

    one = learned(1, False)
    assert not adapted(one).as_written
    assert bits(learned(1, False).state_dict()) == bits(one.state_dict())
    state = np.array([0.1, 0.2])
    expected = one.model.step(state, 0).state
    ended = learned(1, True).model  # nothing is learned but that every step ends
    assert ended.step(state, 0).state.tobytes() == ended.written.step(state, 0).state.tobytes()
    assert going_on(ended.core.step(state, 0)[1]) < 0.01
    assert learned(2, False).model.step(state, 0).state.tobytes() != expected.tobytes()


@pytest.mark.parametrize("mode", ["off", "parameters", "residual", "full"])
def test_an_action_that_the_model_does_not_know_is_recorded_and_teaches_nothing(mode):
    of = adaptation(PLANE, mode)
    rng = np.random.default_rng(0)
    for _ in range(100):
        of.visit(-1)
        of.observe(rng.normal(size=2), -1, rng.normal(size=2), False)
    assert len(of.experience) == 100
    assert of.visits.tolist() == [0, 0]
    states = rng.normal(size=(20, 2))
    expected = from_text(PLANE).model.replace(dt=0.1).step(states, 0)
    assert of.model.step(states, 0).state.tobytes() == expected.state.tobytes()


def test_where_an_event_has_the_last_word_nothing_is_learned():
    """A clamp hides what effects have done: any error below it says nothing."""
    text = """(define (domain clamp) (:functions (x))
      (:action down :parameters () :precondition (and) :effect (and (decrease (x) 0.5)))
      (:event floor :parameters () :precondition (and (< (x) 0.25))
        :effect (and (assign (x) 0.25))))"""
    of = adaptation(text)
    rng = np.random.default_rng(0)
    for _ in range(200):
        of.observe(rng.uniform(0.26, 0.7, size=1), 0, np.array([0.25]), False)
    states = rng.uniform(0.26, 3.0, size=(50, 1))
    expected = adapted(of).written.step(states, 0).state
    assert of.model.step(states, 0).state.tobytes() == expected.tobytes()
    for _ in range(100):  # above it, something else is found
        state = rng.uniform(1.0, 3.0, size=1)
        of.observe(state, 0, state - 0.125, False)
    assert of.model.step(np.array([2.0]), 0).state[0] == pytest.approx(1.875, abs=1e-3)
    assert of.model.step(np.array([0.3]), 0).state[0] == 0.25


def test_where_an_action_is_not_applicable_nothing_is_learned():
    text = """(define (domain gate) (:predicates (open)) (:functions (x))
      (:action go :parameters () :precondition (and (open)) :effect (and (increase (x) 1)))
      (:action shut :parameters () :precondition (and) :effect (and (not (open)))))"""
    of = adaptation(text)
    rng = np.random.default_rng(0)
    shut = next(f.index for f in of.model.fluents if f.name == "open")
    for _ in range(60):
        state = rng.normal(size=2)
        state[shut] = 0.0
        after = rng.normal(size=2)
        after[shut] = 0.0
        of.visit(0)
        of.observe(state, 0, after, False)
    state[shut] = 1.0
    expected = adapted(of).written.step(state, 0).state
    assert of.model.step(state, 0).state.tobytes() == expected.tobytes()
    assert of.visits.tolist() == [60, 0]
