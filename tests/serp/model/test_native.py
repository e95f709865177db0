"""Machine code against CPython, bit for bit, and the cache of compiled models."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest

from serp.model.codegen import generate_code
from serp.model.native import compile_native, structure_digest
from serp.model.transition_model import Outcome, TransitionModel, Vector
from tests.generated import FULL, PLANNABLE, Texts, generate, load_texts, random_states


def row_by_row(model: TransitionModel, states: Vector, actions: list[int]) -> Outcome:
    rows = [model.step(s, a) for s, a in zip(states, actions, strict=True)]
    return Outcome(
        np.array([r.state for r in rows]).reshape(states.shape),
        np.array([r.reward for r in rows]),
        np.array([r.unsafe for r in rows]),
        np.array([r.terminal for r in rows]),
        np.array([r.applicable for r in rows]),
        np.array([r.risk for r in rows]),
    )


def effects_of(model: TransitionModel) -> int:
    ground = model.ground
    everything = (*ground.actions, *ground.processes, *ground.events)
    return sum(len(s.effects) for s in everything) if ground.actions else 0


def check_same_bits(batched: Outcome, single: Outcome) -> None:
    assert batched.state.tobytes() == single.state.tobytes()
    assert batched.reward.tobytes() == single.reward.tobytes()
    assert batched.unsafe.tolist() == single.unsafe.tolist()
    assert batched.terminal.tolist() == single.terminal.tolist()
    assert batched.applicable.tolist() == single.applicable.tolist()
    assert batched.risk.tolist() == single.risk.tolist()
    assert np.isfinite(batched.state).all() and np.isfinite(batched.reward).all()


@pytest.mark.parametrize("seed", range(30))
def test_machine_code_gives_the_same_bits(seed: int) -> None:
    random = Random(1000 + seed)
    model = generate(random, FULL if seed % 2 else PLANNABLE).model
    while not 0 < effects_of(model) < 60:  # compiling a large one takes seconds
        model = generate(random).model
    model = model.replace(dt=random.choice((1.0, 0.25, 0.02)))
    states = random_states(random, model, 50)
    actions = [random.randrange(len(model.actions)) for _ in states]
    check_same_bits(model.step(states, actions), row_by_row(model, states, actions))
    changed = model.replace(theta=model.theta * 1.5)  # the same machine code, other literals
    check_same_bits(changed.step(states, actions), row_by_row(changed, states, actions))


def test_a_batch_mixes_applicable_and_not() -> None:
    model = load_texts(
        Texts(
            "(define (domain d) (:predicates (lit) (unsafe)) (:functions (heat) (reward))"
            " (:action on :precondition (and (not (lit)))"
            "  :effect (and (lit) (increase (reward) 2) (when (> (heat) 1) (unsafe))))"
            " (:action invert :effect (and (assign (heat) (/ 1 (heat))))))",
            None,
        )
    ).model
    states = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [0.0, 0.0], [1.0, 4.0]])
    outcome = model.step(states, [0, 0, 0, 1, 1])
    assert outcome.applicable.tolist() == [True, False, True, False, True]
    assert outcome.state.tolist() == [[1.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 0.0], [1.0, 0.25]]
    assert outcome.reward.tolist() == [2.0, 0.0, 2.0, 0.0, 0.0]
    assert outcome.unsafe.tolist() == [False, False, True, False, False]
    one_for_all = model.step(states, "on")
    assert one_for_all.applicable.tolist() == [True, False, True, True, False]


def test_batches_of_none_and_states_of_nothing() -> None:
    model = load_texts(Texts("(define (domain d) (:action wait))", None)).model
    assert model.step(np.zeros((0, 0)), []).state.shape == (0, 0)
    assert model.step(np.zeros((3, 0)), 0).applicable.tolist() == [True] * 3


def test_rows_that_are_not_contiguous() -> None:
    random = Random(1001)
    model = generate(random).model
    states = random_states(random, model, 20)
    spread = np.zeros((40, states.shape[1]))[::2]
    spread[:] = states
    check_same_bits(model.step(spread, 0), model.step(states, 0))
    check_same_bits(model.step(np.asfortranarray(states), 0), model.step(states, 0))


def test_models_too_large_to_compile_run_in_cpython(monkeypatch: pytest.MonkeyPatch) -> None:
    random = Random(1001)
    model = generate(random).model
    states = random_states(random, model, 20)
    compiled = model.step(states, 0)
    monkeypatch.setattr("serp.model.program.MAX_NATIVE_SIZE", -1)
    assert not model.compiles
    check_same_bits(model.step(states, 0), compiled)
    assert model.step(states[:0], 0).state.shape == (0, states.shape[1])


# The cache -------------------------------------------------------------------------------------


def one_action(literal: str) -> Texts:
    return Texts(
        "(define (domain d) (:functions (heat))"
        f" (:action warm :effect (increase (heat) {literal})))",
        None,
    )


def test_a_compiled_model_is_found_again_and_so_is_one_with_other_literals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SERP_CACHE_DIR", str(tmp_path / "new"))
    hits = [
        compile_native(generate_code(load_texts(one_action(literal)).model.ground)).cache_hits
        for literal in ("0.5", "0.5", "0.75")
    ]
    assert hits == [0, 1, 1]


def test_the_digest_tells_structures_apart() -> None:
    def digest(texts: Texts) -> str:
        return structure_digest(generate_code(load_texts(texts).model.ground))

    assert digest(one_action("0.5")) == digest(one_action("-2"))
    assert digest(one_action("0.5")) != digest(one_action("(heat)"))
