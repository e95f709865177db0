"""The compiled model against the slow reading of the same text, bit for bit."""

from __future__ import annotations

import struct
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from serp.model.codegen import generate_code
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.ground import REWARD_TARGET, SetBoolean, reads, writes
from serp.model.instantiate import instantiate
from serp.model.native import structure_digest
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl import syntax as x
from serp.pddl.parser import parse_domain
from serp.pddl.source import DomainError, Source
from tests.generated import (
    Generated,
    Texts,
    examples,
    generate,
    load_texts,
    models,
    models_with_states,
    random_states,
)
from tests.generated.oracle import NotApplicable, State


def bits(value: bool | float) -> bytes:
    return struct.pack("<d", value)


def spelled_bits(state: State) -> dict[tuple[str, ...], bytes]:
    return {key: bits(value) for key, value in state.items()}


def check_step(generated: Generated, state: Vector, dt: float) -> None:
    """Every action of the model, in one state, gives what the oracle says."""
    model = generated.model.replace(dt=dt)
    spelled = generated.spelled(state)
    for index, action in enumerate(model.actions):
        said = generated.oracle.step(spelled, action.name, dt)
        found = model.step(state, index)
        assert found.applicable == said.applicable, action.name
        assert spelled_bits(generated.spelled(found.state)) == spelled_bits(said.state), action.name
        assert bits(found.reward) == bits(said.reward), action.name
        assert (found.unsafe, found.terminal) == (said.unsafe, said.terminal), action.name
        assert np.isfinite(found.state).all() and np.isfinite(found.reward)


@given(models_with_states(), st.sampled_from((1.0, 0.25, 0.02)))
@examples(80)
def test_model_equals_the_slow_reading(drawn: tuple[Generated, Vector], dt: float) -> None:
    generated, states = drawn
    for state in states:
        check_step(generated, state, dt)


@pytest.mark.parametrize("block", range(8))
def test_model_equals_the_slow_reading_on_seeded_domains(block: int) -> None:
    for seed in range(block * 25, block * 25 + 25):
        random = Random(seed)
        generated = generate(random)
        for state in random_states(random, generated.model, 6):
            check_step(generated, state, 0.5)


@given(models_with_states(count=4))
@examples(60)
def test_what_instantiation_leaves_out_is_never_applicable(
    drawn: tuple[Generated, Vector],
) -> None:
    generated, states = drawn
    every = list(generated.oracle.instances(x.Kind.ACTION))
    kept = [action.name for action in generated.model.actions]
    assert [name for name in every if name in set(kept)] == kept  # the order of the file
    for state in states:
        for name in set(every) - set(kept):
            assert not generated.oracle.step(generated.spelled(state), name).applicable


@given(models())
@examples(60)
def test_fluents_are_all_terms_but_the_static_ones(generated: Generated) -> None:
    model = generated.domain.observed().model
    columns = {(f.symbol, *f.arguments): f.numeric for f in model.fluents}
    terms = generated.oracle.terms()
    static = {name for name, *_ in terms} - {name for name, *_ in columns}
    assert columns == {key: kind for key, kind in terms.items() if key[0] not in static}
    changed = {f"{model.fluents[t].symbol}" for a in model.actions for t in writes(a) if t >= 0}
    assert not static & changed
    initial = generated.oracle.initial()
    for name, value in model.ground.static.items():
        assert initial[tuple(name.split())] == value


@given(models())
@examples(60)
def test_what_nothing_reachable_changes_is_as_at_the_start_and_missing_numbers_are_zero(
    generated: Generated,
) -> None:
    model, wider = generated.domain.model, generated.domain.observed().model
    assert {f.name for f in model.fluents} <= {f.name for f in wider.fluents}
    initial = {key: 0.0 for key in generated.oracle.terms()} | generated.oracle.initial()
    for name, value in model.ground.static.items():
        assert initial[tuple(name.split())] == value
    if model.initial_state is not None:
        assert model.initial_state.tolist() == [
            float(initial[(f.symbol, *f.arguments)]) for f in model.fluents
        ]


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
    for seed in range(300):
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
    assert judged > 500


@given(models_with_states(count=2))
@examples(60)
def test_judging_an_unknown_action_is_defined(drawn: tuple[Generated, Vector]) -> None:
    generated, (before, after) = drawn
    try:
        judgement = generated.model.judge(before, -1, after)
    except StateError:  # an event divides by zero there
        assume(False)
    assert np.isfinite(judgement.reward)


# Literals --------------------------------------------------------------------------------------


def with_literal(texts: Texts, generated: Generated, index: int, literal: str) -> Texts:
    """The same files with one literal written anew, at the place that its parameter names."""
    place = generated.model.parameters[index].place
    in_problem = place.source is generated.domain.problem_source
    text = place.source.text[: place.start] + literal + place.source.text[place.end :]
    return Texts(texts.domain, text) if in_problem else Texts(text, texts.problem)


@given(models_with_states(count=4), st.integers(0, 10**6), st.integers(-12, 12))
@examples(40)
def test_a_changed_literal_is_a_changed_theta(
    drawn: tuple[Generated, Vector], choice: int, quarters: int
) -> None:
    generated, states = drawn
    model = generated.model
    written = [p for p in model.parameters if p.role != "goal"]
    assume(written)
    index = written[choice % len(written)].index
    literal = f"{quarters / 4:g}"
    texts = with_literal(generated.texts, generated, index, literal)
    rewritten = load_texts(texts, observed=generated.domain.supplied is not None).model
    theta = model.theta.copy()
    theta[index] = quarters / 4
    replaced = model.replace(theta=theta)
    assert rewritten.theta.tobytes() == replaced.theta.tobytes()
    assert replaced.theta[index] == quarters / 4
    assert structure_digest(generate_code(rewritten.ground)) == structure_digest(
        generate_code(model.ground)
    )
    for state in states:
        for action in range(len(model.actions)):
            left, right = replaced.step(state, action), rewritten.step(state, action)
            assert left.state.tobytes() == right.state.tobytes()
            assert left[1:] == right[1:]


@given(models())
@examples(60)
def test_every_parameter_stands_where_its_place_says(generated: Generated) -> None:
    model = generated.model
    written = [p for p in model.parameters if p.role != "goal"]  # which follows from the others
    for parameter in written:
        assert float(parameter.place.text) == parameter.value == model.theta[parameter.index]
    assert len({(p.place.source.name, p.place.start) for p in written}) == len(written)


# Explanations ----------------------------------------------------------------------------------


@given(models_with_states(count=4))
@examples(40)
def test_trace_agrees_with_step_and_names_what_took_part(drawn: tuple[Generated, Vector]) -> None:
    generated, states = drawn
    model = generated.model
    for state in states:
        spelled = generated.spelled(state)
        for index, action in enumerate(model.actions):
            sites, flags = model.trace(state, index)
            step = model.step(state, index)
            assert bool(flags & APPLICABLE) == step.applicable
            if not step.applicable:
                assert (flags == 0) == (sites[-1].what == "failed")
                assert (flags & UNDEFINED != 0) == (flags != 0)
                assert sites[-1].what in ("failed", "conflict", "undefined")
                assert {site.what for site in sites[:-1]} <= {"effect", "rate"}
                if sites[-1].what == "failed":  # before anything was applied
                    assert len(sites) == 1 and sites[0].item in action.preconditions
                schema, binding = generated.oracle.instances(x.Kind.ACTION)[action.name]
                fresh = {**spelled, ("unsafe",): False, ("terminal",): False}
                undecided = sites[-1].what == "undefined" and any(
                    sites[-1].item is test for test in action.preconditions
                )
                try:
                    enabled = generated.oracle.enabled(schema, fresh, binding)
                except NotApplicable:
                    assert undecided
                else:
                    assert enabled == (sites[-1].what != "failed" and not undecided)
                continue
            assert bool(flags & UNSAFE) == step.unsafe
            assert bool(flags & TERMINAL) == step.terminal
            assert {site.what for site in sites} <= {"effect", "rate"}
            assert all(site.schema is not None and site.item is not None for site in sites)
            named = {s.item.target for s in sites if isinstance(s.item, SetBoolean)}
            assert step.unsafe == (-2 in named)
            changed = np.flatnonzero(step.state != state)
            assert set(changed.tolist()) <= {s.item.target for s in sites}  # type: ignore[union-attr]


# States and arguments --------------------------------------------------------------------------


def small() -> TransitionModel:
    return load_texts(
        Texts(
            "(define (domain d) (:predicates (lit)) (:functions (heat))"
            " (:action on :parameters () :precondition (and (not (lit))) :effect (and (lit)))"
            " (:action warm :parameters () :precondition (and)"
            "  :effect (and (increase (heat) 0.5))))",
            None,
        )
    ).model


def test_state_by_name_and_back() -> None:
    model = small()
    state = model.state({"heat": 1.5, "lit": True})
    assert state.tolist() == [1.0, 1.5]
    assert model.values(state) == {"lit": True, "heat": 1.5}


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"heat": 1.0}, "no value for fluent `lit`; given are `heat`"),
        ({"heat": 1.0, "lit": True, "het": 2.0}, "did you mean `heat`"),
        ({"heat": float("nan"), "lit": True}, "fluent `heat` is nan"),
        ({"heat": float("inf"), "lit": True}, "fluent `heat` is inf"),
        ({"heat": 1.0, "lit": 0.5}, "`lit` is 0 or 1, not 0.5"),
    ],
)
def test_states_that_do_not_fit_are_refused(values: dict[str, float], says: str) -> None:
    with pytest.raises(StateError, match=says):
        small().state(values)


@pytest.mark.parametrize(
    ("length", "says"),
    [(1, "2 numbers .* found 1: there is none for `heat`"), (3, "found 3: 1 more than the fl")],
)
def test_a_state_of_a_wrong_length_names_fluents(length: int, says: str) -> None:
    with pytest.raises(StateError, match=says):
        small().check_state(np.zeros(length))


def test_a_static_value_in_a_state_is_refused_with_the_reason() -> None:
    texts = Texts(
        "(define (domain d) (:predicates (lit)) (:functions (cost)) (:action on :effect (lit)))",
        "(define (problem p) (:domain d) (:init (= (cost) 2)))",
    )
    with pytest.raises(StateError, match="fixed by the problem file"):
        load_texts(texts).model.state({"lit": True, "cost": 2.0})


def test_actions_by_name_or_position() -> None:
    model = small()
    state = model.state({"heat": 0.0, "lit": False})
    for action in ("warm", "(warm)", "WARM", 1, np.int64(1)):
        assert model.step(state, action).state.tolist() == [0.0, 0.5]


@pytest.mark.parametrize(
    ("action", "says"),
    [
        ("warn", "did you mean `warm`"),
        (2, "action 2"),
        (-1, "action -1"),
        (0.5, "name or a position"),
        (None, "name or a position"),
        (True, "name or a position"),
    ],
)
def test_unknown_actions_are_refused(action: object, says: str) -> None:
    with pytest.raises(StateError, match=says):
        small().step(np.zeros(2), action)


@pytest.mark.parametrize("action", [2, -1, [0, 2], [0, 1, 0], [0.0, 1.0], [[0, 1]], "warn"])
def test_unknown_actions_of_a_batch_are_refused(action: object) -> None:
    with pytest.raises(StateError):
        small().step(np.zeros((2, 2)), action)


@pytest.mark.parametrize("shape", [(3,), (2, 3), (), (1, 2, 2)])
def test_states_of_a_wrong_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(StateError):
        small().step(np.zeros(shape), 0)


@pytest.mark.parametrize("theta", [[], [1.0, 2.0], [float("nan")], [float("inf")]])
def test_thetas_that_do_not_fit_are_refused(theta: list[float]) -> None:
    with pytest.raises(StateError, match="theta must be 1 finite"):
        small().replace(theta=theta)


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), float("inf"), "a", True, [1.0]])
def test_control_periods_that_make_no_sense_are_refused(dt: float) -> None:
    with pytest.raises(StateError, match="control period"):
        small().replace(dt=dt)


@pytest.mark.parametrize("state", ["abc", ["a", "b"], [[1.0], [2.0, 3.0]], {"heat": 1.0}])
def test_what_is_no_numbers_is_refused_as_a_state(state: object) -> None:
    for use in (small().check_state, lambda state: small().step(state, 0)):
        with pytest.raises(StateError, match="a state is numbers"):
            use(state)  # type: ignore[operator]


def test_what_names_no_fluents_is_refused_as_a_state() -> None:
    for values in ([1.0], None, {1: 2.0}, {"heta": 1.0}):
        with pytest.raises(StateError, match=r"fluent"):
            small().state(values)  # type: ignore[arg-type]


@pytest.mark.parametrize("action", [-2, 2])
def test_judging_an_action_that_does_not_exist_is_refused(action: int) -> None:
    with pytest.raises(StateError, match=f"action {action} "):
        small().judge(np.zeros(2), action, np.zeros(2))


def test_a_large_domain_costs_what_is_used_of_it() -> None:
    count = 3_000
    objects = " ".join(f"o{k}" for k in range(count))
    source = Source(
        "large.pddl",
        f"(define (domain d) (:types t) (:constants {objects} - t) (:predicates (on ?o - t))"
        " (:action light :parameters (?o - t) :precondition (and) :effect (and (on ?o))))",
    )
    model = TransitionModel(instantiate(parse_domain(source), None))
    state = np.zeros(count)
    assert model.step(state, "light o7").state.nonzero()[0].tolist() == [7]
    assert [site.what for site in model.trace(state, 8)[0]] == ["effect"]
    assert [k for part, k in model._program._functions if part == "action"] == [7]


def test_theta_cannot_be_changed_in_place() -> None:
    model = small()
    with pytest.raises(ValueError, match="read-only"):
        model.theta[0] = 3.0


def test_a_step_leaves_its_argument_alone() -> None:
    model = small()
    state = np.zeros(2)
    model.step(state, "warm").state[0] = 7.0
    model.step(state, "on").state[0] = 7.0
    assert state.tolist() == [0.0, 0.0]


def test_too_many_instances_are_refused_by_the_limit_given() -> None:
    domain = generate(Random(0)).domain
    with pytest.raises(DomainError, match="more than 1 ground actions"):
        instantiate(domain.syntax, domain.problem_syntax, max_ground_schemas=1)
