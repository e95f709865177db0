"""The compiled model against the slow reading of the same text, bit for bit."""

import struct
from random import Random

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from serp.model.flags import UNDEFINED
from serp.model.ground_model import UNSAFE_TARGET, SetBoolean
from serp.pddl import syntax as x
from tests.generated import examples, generate, models_with_states, random_states
from tests.generated.oracle import NotApplicable


def bits(value):
    return struct.pack("<d", value)


def spelled_bits(state):
    return {key: bits(value) for key, value in state.items()}


@given(models_with_states(count=6), st.sampled_from((1.0, 0.25, 0.02)))
@examples(60)
def test_steps_and_traces_are_those_of_the_slow_reading(drawn, dt):
    generated, states = drawn
    model = generated.model.replace(dt=dt)
    for state in states:
        spelled = generated.spelled(state)
        for index, action in enumerate(model.actions):
            said = generated.oracle.step(spelled, action.name, dt)
            found = model.step(state, index)
            assert found.applicable == said.applicable, action.name
            assert spelled_bits(generated.spelled(found.state)) == spelled_bits(said.state)
            assert bits(found.reward) == bits(said.reward), action.name
            assert (found.unsafe, found.terminal) == (said.unsafe, said.terminal), action.name
            assert np.isfinite(found.state).all() and np.isfinite(found.reward)
            check_trace(generated, model, state, index, found)


def check_trace(generated, model, state, index, found):
    """A trace has the flags of the step, and names what took part or what is to blame."""
    sites, flags = model.trace(state, index)
    out, same_flags, passages = model.traced(state.tolist(), index)
    assert flags == same_flags == model.transition(state.tolist(), index)[1]
    assert [passage.site for passage in passages] == sites
    if found.applicable:
        assert np.array(out).tobytes() == np.append(found.state, found.reward).tobytes()
    last = len(sites) if found.applicable else -1
    assert {site.what for site in sites[:last]} <= {"effect", "rate"}
    if found.applicable:
        assert all(site.schema is not None and site.item is not None for site in sites)
        named = {s.item.target for s in sites if isinstance(s.item, SetBoolean)}
        assert found.unsafe == (UNSAFE_TARGET in named)
        changed = np.flatnonzero(found.state != state)
        assert set(changed.tolist()) <= {s.item.target for s in sites}
        return
    blamed, action = sites[-1], model.actions[index]
    assert (flags == 0) == (blamed.what == "failed") != bool(flags & UNDEFINED)
    assert blamed.what in ("failed", "conflict", "undefined")
    known = any(blamed.item is test for test in action.preconditions)
    assert blamed.what != "failed" or (known and len(sites) == 1)  # before anything was applied
    schema, binding = generated.oracle.instances(x.Kind.ACTION)[action.name]
    fresh = {**generated.spelled(state), ("unsafe",): False, ("terminal",): False}
    try:
        enabled = generated.oracle.enabled(schema, fresh, binding)
    except NotApplicable:
        enabled = None
    assert enabled == (False if blamed.what == "failed" else None if known else True)


# Reading an observed transition ----------------------------------------------------------------


def test_judging_the_predicted_result_gives_the_predicted_reward():
    judged = 0
    for seed in range(100):
        random = Random(seed)
        generated = generate(random)
        for state in random_states(random, generated.model, 4):
            for index in range(len(generated.model.actions)):
                step = generated.model.step(state, index)
                if step.applicable:
                    judgement = generated.model.judge(state, index, step.state)
                    assert bits(judgement.reward) == bits(step.reward)
                    assert judgement[1:] == (step.unsafe, step.terminal)
                    judged += 1
    assert judged > 150
