"""Effects by chance are outcomes of an action, with the probabilities that the file gives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.domain import Domain
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE, risk_of
from serp.pddl.source import DomainError, Source
from serp.planning.far_sight import FarSightPlanner
from serp.settings import Settings
from serp.tasks.file_world import FileWorld, WorldOptions

HEAD = """(define (domain chance) (:requirements :typing :probabilistic-effects :rewards)
  (:types cell) (:constants a b - cell) (:predicates (wet ?c - cell) (unsafe) (terminal))
  (:functions (x))
  (:action go :parameters () :precondition (and (< (x) 9)) :effect {})
  (:action crawl :parameters () :precondition (and) :effect (increase (x) 0.5))
  (:action rain :parameters () :precondition (and) :effect (and (wet a) (wet b)))
  (:action dry :parameters () :precondition (and) :effect (and (not (wet a)) (not (wet b))
    (assign (x) 0))))"""
PROBLEM = """(define (problem p) (:domain chance)
  (:init (= (x) 0) (wet a)) (:goal (> (x) 2)) (:goal-reward 50))"""


def model_of(effect, problem=PROBLEM):
    return domain_of(effect, problem).model


def domain_of(effect, problem=PROBLEM):
    return Domain.parse(Source("chance.pddl", HEAD.format(effect)), Source("p.pddl", problem))


def outcomes_of(model, state=None, action=0):
    state = model.initial_state if state is None else state
    return {
        tuple(row[: -3]): row[-1] for row in model.core.outcomes(state, action)
    }  # fmt: skip


def test_outcomes_are_those_that_are_written():
    model = model_of("(and (increase (x) 1) (probabilistic 0.5 (wet b) 1/4 (increase (x) 2)))")
    found = [
        (model.values(np.array(state))["x"], model.values(np.array(state))["wet b"], probability)
        for state, probability in outcomes_of(model).items()
    ]
    assert sorted(found) == [(1.0, False, 0.25), (1.0, True, 0.5), (3.0, False, 0.25)]


def test_chances_are_independent():
    model = model_of("(and (oneof (wet b) (not (wet a))) (probabilistic 0.5 (increase (x) 1)))")
    assert sorted(outcomes_of(model).values()) == [0.25] * 4
    each = model_of("(forall (?c - cell) (probabilistic 0.5 (wet ?c)))")
    assert len(each.actions[0].outcomes) + 1 == 4


def test_an_outcome_may_depend_on_the_state():
    model = model_of("(probabilistic 0.9 (when (wet a) (increase (x) 1)))")
    dry = model.state({"x": 0, "wet a": 0, "wet b": 0})
    assert sorted(outcomes_of(model).values()) == pytest.approx([0.1, 0.9])
    assert {state for state in outcomes_of(model, dry)} == {tuple(dry)}


EFFECTS = st.sampled_from([
    "(increase (x) 1)", "(wet b)", "(not (wet a))", "(unsafe)", "(terminal)",
    "(increase (reward) 2)", "(when (wet a) (assign (x) 5))", "(when (> (/ 1 (x)) 0) (wet b))",
])  # fmt: skip


@given(st.lists(st.tuples(st.integers(1, 5), EFFECTS), min_size=1, max_size=4), EFFECTS,
       st.floats(0, 12), st.booleans())  # fmt: skip
def test_the_fast_step_is_the_traced_one_and_what_its_outcomes_come_to(parts, always, x, wet):
    total = sum(weight for weight, _ in parts)
    chances = " ".join(f"{weight}/{total} {effect}" for weight, effect in parts)
    model = model_of(f"(and (decrease (reward) 1) (probabilistic {chances}) {always})")
    state = model.state({"x": x, "wet a": wet, "wet b": not wet})
    count = 1 + len(model.actions[0].outcomes)
    flags, reward, risk = [], 0.0, 0.0
    for k in range(count):
        out, of = model.written_core().step_of_outcome(state, 0, k)
        traced = model.traced(state.tolist(), 0, outcome=k)
        assert traced.flags == of
        if of & APPLICABLE:
            assert traced.out == out.tolist()
        flags.append(of)
        probability = model.actions[0].outcomes[k - 1].probability if k else None
        if probability is None:
            probability = 1.0 - sum(o.probability for o in model.actions[0].outcomes)
        reward += probability * out[-1]
        risk += probability * bool(of & UNSAFE)
    out, joint = model.transition(state.tolist(), 0)
    assert bool(joint & APPLICABLE) == all(of & APPLICABLE for of in flags)
    if joint & APPLICABLE:
        assert out[-1] == pytest.approx(reward)
        assert risk_of(joint) == pytest.approx(risk, abs=1e-6)
        assert bool(joint & UNSAFE) == all(of & UNSAFE for of in flags)
        assert bool(joint & TERMINAL) == bool(flags[0] & TERMINAL)
        rows = model.core.outcomes(state, 0)
        assert rows[:, -1].sum() == pytest.approx(1.0)


def test_a_world_draws_the_outcomes():
    domain = domain_of("(probabilistic 0.7 (increase (x) 1) 0.2 (decrease (x) 1))")
    world = FileWorld(domain, WorldOptions())
    world.reset(seed=0)
    column = world.model.ground.fluents.index(next(f for f in world.model.fluents if f.numeric))
    moved = []
    for _ in range(2_000):
        world.state = world.model.initial_state
        moved.append(world.step(0)[0][column])
    shares = [np.mean(np.array(moved) == by) for by in (1.0, -1.0, 0.0)]
    assert shares == pytest.approx([0.7, 0.2, 0.1], abs=0.04)


def test_an_observed_reward_is_that_of_the_outcome_that_took_place():
    model = model_of("(probabilistic 0.6 (increase (x) 1) 0.4 (and (wet b) (increase (reward) 7)))")
    before = model.initial_state
    for outcome in (0, 1):
        out, _ = model.written_core().step_of_outcome(before, 0, outcome)
        assert model.judge(before, 0, out[:-1]).reward == 7.0 * outcome


@pytest.mark.parametrize(("chance", "choice"), [("0.1", 1), ("0.001", 0)])
def test_a_planner_weighs_the_risk_of_an_outcome(chance, choice):
    model = model_of(f"(and (increase (x) 1) (probabilistic {chance} (unsafe)))")
    settings = Settings().planner.replace(name="far-sight", accepted_risk=0.02)
    found = FarSightPlanner(model, settings).forecast(model.initial_state)
    assert found.choice == choice


MANY = " ".join(f"(probabilistic 0.5 (increase (x) {2**k}))" for k in range(5))


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ("(probabilistic 0.8)", "takes pairs of a probability and an effect"),
        ("(probabilistic 0.8 (wet a) 0.3 (wet b))", "the probabilities add up to 1.1"),
        ("(probabilistic 2 (wet a))", "a probability must be a number from 0 to 1"),
        ("(oneof)", "`oneof` is empty"),
        (f"(and {MANY})", "more than 16 outcomes"),
    ],
)
def test_a_mistake_is_named_with_its_place(effect, message):
    with pytest.raises(DomainError, match=message) as refused:
        _ = model_of(effect)
    assert "chance.pddl:4:" in str(refused.value)


def test_a_process_and_an_event_have_no_chance():
    text = (
        HEAD.format("(and)")[:-1]
        + " (:event e :parameters () :precondition (> (x) 5) :effect (oneof (wet a))))"
    )
    with pytest.raises(DomainError, match="supported in actions only"):
        Domain.parse(Source("chance.pddl", text))
