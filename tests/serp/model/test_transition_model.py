"""The compiled model against the slow reading of the same text, bit for bit."""

from __future__ import annotations

import struct
from random import Random

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from serp.model.flags import UNDEFINED
from serp.model.ground_model import REWARD_TARGET, UNSAFE_TARGET, SetBoolean, reads, writes
from serp.model.instructions import compile_program
from serp.model.transition_model import Outcome, TransitionModel, Vector
from serp.pddl import syntax as x
from serp.pddl.source import DomainError
from tests.generated import (
    Generated,
    Texts,
    examples,
    generate,
    load_texts,
    models_with_states,
    random_states,
)
from tests.generated.oracle import NotApplicable, State


def bits(value: bool | float) -> bytes:
    return struct.pack("<d", value)


def spelled_bits(state: State) -> dict[tuple[str, ...], bytes]:
    return {key: bits(value) for key, value in state.items()}


@given(models_with_states(count=6), st.sampled_from((1.0, 0.25, 0.02)))
@examples(250)
def test_steps_and_traces_are_those_of_the_slow_reading(
    drawn: tuple[Generated, Vector], dt: float
) -> None:
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


def check_trace(
    generated: Generated, model: TransitionModel, state: Vector, index: int, found: Outcome
) -> None:
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
        assert set(changed.tolist()) <= {s.item.target for s in sites}  # type: ignore[union-attr]
        return
    blamed, action = sites[-1], model.actions[index]
    assert (flags == 0) == (blamed.what == "failed") != bool(flags & UNDEFINED)
    assert blamed.what in ("failed", "conflict", "undefined")
    known = any(blamed.item is test for test in action.preconditions)
    assert blamed.what != "failed" or (known and len(sites) == 1)  # before anything was applied
    schema, binding = generated.oracle.instances(x.Kind.ACTION)[action.name]
    fresh = {**generated.spelled(state), ("unsafe",): False, ("terminal",): False}
    try:
        enabled: bool | None = generated.oracle.enabled(schema, fresh, binding)
    except NotApplicable:
        enabled = None
    assert enabled == (False if blamed.what == "failed" else None if known else True)


# Reading an observed transition ----------------------------------------------------------------


def settled(model: TransitionModel) -> bool:
    """Whether reward and flags of a step can be read off its result."""
    ground = model.ground
    looked_at = set().union(*(reads(event) for event in ground.events))
    changed = set().union(*(writes(event) for event in ground.events))
    processes_reward = any(REWARD_TARGET in writes(process) for process in ground.processes)
    return not processes_reward and not (looked_at & {t for t in changed if t >= 0})


def test_judging_the_predicted_result_gives_the_predicted_reward() -> None:
    judged = 0
    for seed in range(200):
        random = Random(seed)
        generated = generate(random)
        if not settled(generated.model):
            continue
        for state in random_states(random, generated.model, 4):
            for index in range(len(generated.model.actions)):
                step = generated.model.step(state, index)
                if step.applicable:
                    judgement = generated.model.judge(state, index, step.state)
                    assert bits(judgement.reward) == bits(step.reward)
                    assert judgement[1:] == (step.unsafe, step.terminal)
                    judged += 1
    assert judged > 300


# Parameters ------------------------------------------------------------------------------------


def with_number(generated: Generated, index: int, number: str) -> Texts:
    """The same files with one number written anew, at the place that its parameter names."""
    place = generated.model.parameters[index].place
    in_problem = place.source is generated.domain.problem_source
    text = place.source.text[: place.start] + number + place.source.text[place.end :]
    texts = generated.texts
    return Texts(texts.domain, text) if in_problem else Texts(text, texts.problem)


@given(models_with_states(count=4), st.integers(0, 10**6), st.integers(-12, 12))
@examples(60)
def test_a_number_of_a_file_is_a_parameter_with_its_place(
    drawn: tuple[Generated, Vector], choice: int, quarters: int
) -> None:
    """Another number in the file and another θ are the same model, with the same table."""
    generated, states = drawn
    model = generated.model
    written = [p for p in model.parameters if p.role != "goal"]  # which follows from the others
    for parameter in written:
        assert float(parameter.place.text) == parameter.value == model.theta[parameter.index]
    assert len({(p.place.source.name, p.place.start) for p in written}) == len(written)
    assume(written)
    index = written[choice % len(written)].index
    texts = with_number(generated, index, f"{quarters / 4:g}")
    try:
        rewritten = load_texts(texts, observed=generated.domain.supplied is not None).model
    except DomainError as error:  # `(sqrt -1)`
        assert error.advice == "it never has a result"
        assume(False)
    theta = model.theta.copy()
    theta[index] = quarters / 4
    replaced = model.replace(theta=theta)
    assert rewritten.theta.tobytes() == replaced.theta.tobytes()
    assert replaced.theta[index] == quarters / 4
    codes = [compile_program(m.ground).code.tobytes() for m in (rewritten, model)]
    assert codes[0] == codes[1]
    for state in states:
        for action in range(len(model.actions)):
            left, right = replaced.step(state, action), rewritten.step(state, action)
            assert left.state.tobytes() == right.state.tobytes()
            assert left[1:] == right[1:]
