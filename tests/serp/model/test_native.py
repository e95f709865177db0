"""Machine code and bytecode against CPython, bit for bit."""

from __future__ import annotations

from functools import partial
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import SerpError
from serp.model.transition_model import Outcome, TransitionModel, Vector
from tests.generated import (
    FULL,
    PLANNABLE,
    Generated,
    Texts,
    examples,
    generate,
    load_texts,
    models_with_states,
    random_states,
)


def in_cpython(model: TransitionModel, states: Vector, actions: list[int]) -> Outcome:
    """A batch, one by one."""
    rows = [model.step(state, action) for state, action in zip(states, actions, strict=True)]
    return Outcome(*map(np.array, zip(*rows, strict=True)))


def as_bytecode(model: TransitionModel, states: Vector, actions: list[int]) -> Outcome:
    """A batch of a model that is taken to be too large for machine code of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.model.program.MAX_NATIVE_SIZE", -1)
        assert not model.program.has_own_code
        return model.step(states, actions)


def check_same_bits(one: Outcome, other: Outcome) -> None:
    for name, left, right in zip(Outcome._fields, one, other, strict=True):
        assert np.asarray(left).tobytes() == np.asarray(right).tobytes(), name
    assert np.isfinite(one.state).all() and np.isfinite(one.reward).all()


def count_effects(model: TransitionModel) -> int:
    return sum(len(schema.effects) for schema in model.ground.schemas)


@pytest.mark.parametrize("seed", range(20))
def test_machine_code_gives_the_same_bits(seed: int) -> None:
    random = Random(1000 + seed)
    model = generate(random, FULL if seed % 2 else PLANNABLE).model
    while not model.actions or not 0 < count_effects(model) < 60:  # a large one takes seconds
        model = generate(random).model
    model = model.replace(dt=random.choice((1.0, 0.25, 0.02)))
    states = random_states(random, model, 50)
    actions = [random.randrange(len(model.actions)) for _ in states]
    other = model.replace(theta=model.theta * 1.5)  # the same machine code, other parameters
    for changed in (model, other):
        batch = changed.step(states, actions)
        check_same_bits(batch, in_cpython(changed, states, actions))
    spread = np.zeros((100, states.shape[1]))[::2]
    spread[:] = states
    for rows in (spread, np.asfortranarray(states)):  # not contiguous
        check_same_bits(model.step(rows, 0), model.step(states, 0))


@examples(100)
@given(models_with_states(FULL, count=20), st.randoms(use_true_random=False))
def test_bytecode_gives_the_same_bits(drawn: tuple[Generated, Vector], random: Random) -> None:
    generated, states = drawn
    if generated.model.actions:
        actions = [random.randrange(len(generated.model.actions)) for _ in states]
        for dt, factor in ((1.0, 1.0), (0.25, 1.5)):
            model = generated.model.replace(dt=dt, theta=generated.model.theta * factor)
            found = as_bytecode(model, states, actions)
            check_same_bits(found, in_cpython(model, states, actions))


def test_more_variables_than_registers_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serp.model.program.MAX_NATIVE_SIZE", -1)
    monkeypatch.setattr("serp.model.bytecode.REGISTERS", 5)
    assert one_action("2").step(np.ones((1, 1)), 0).applicable.all()
    large = one_action("(* (+ (heat) 1) (- (heat) 3))")
    assert large.step(np.ones(1), 0).applicable
    with pytest.raises(SerpError, match="more than 5 intermediate results"):
        large.step(np.ones((1, 1)), 0)


def test_batches_of_none_and_states_of_nothing() -> None:
    model = load_texts(Texts("(define (domain d) (:action wait))", None)).model
    for step in (model.step, partial(as_bytecode, model)):
        assert step(np.zeros((0, 0)), []).state.shape == (0, 0)
        assert step(np.zeros((3, 0)), [0] * 3).applicable.tolist() == [True] * 3


def one_action(number: str) -> TransitionModel:
    domain = "(define (domain d) (:functions (heat)) (:action warm :effect (increase (heat) {})))"
    return load_texts(Texts(domain.format(number), None)).model
