"""What a problem's initial state leads to, and what is left out because nothing leads to it."""

import itertools
from random import Random

import numpy as np
import pytest
from hypothesis import given

from serp.model.ground_model import writes
from serp.model.reachability import Facts
from serp.pddl import syntax as x
from serp.pddl.source import DomainError
from tests.generated import Texts, examples, load_texts, models_with_states
from tests.worlds import text

LIFT = text("lift")
FLOORS = """(define (problem p) (:domain lift) (:objects f0 f1 f2 f3 - floor)
  (:init (at f0) (stop f0) (stop f2) (stop f3) (above f0 f1) (above f0 f2) (above f1 f2)
    (above f0 f3) (above f2 f3) (above f1 f3)
    (= (time f0 f2) 4) (= (time f2 f3) 3) {}))"""


def test_a_number_is_needed_only_where_an_instance_that_can_be_reached_reads_it():
    texts = Texts(LIFT, FLOORS.format("(= (time f0 f3) 6)"))
    model = load_texts(texts).model  # nobody stops at f1, so its times are of no interest
    assert [a.name for a in model.actions] == ["up f0 f2", "up f0 f3", "up f2 f3"]
    assert [f.name for f in model.fluents] == ["at f0", "at f2", "at f3", "cost"]
    for missing, domain in (
        ("(time f0 f3)", load_texts(Texts(LIFT, FLOORS.format("")))),
        ("(time f1 f2)", load_texts(texts).observed()),  # it may be seen at f1
    ):
        left_out = missing.replace("(time", "up").strip(")")
        assert left_out not in [action.name for action in domain.model.actions]
        told = [w.text for w in domain.warnings if w.code == "missing-value"]
        never = "has no value, so these forms, which read it, never apply"
        assert f"`{missing}` {never}: `{left_out}`" in told


def test_a_goal_that_reads_what_has_no_value_is_refused():
    goal = FLOORS.format("").removesuffix(")") + " (:goal (> (time f0 f3) 1)))"
    with pytest.raises(DomainError, match=r"`\(time f0 f3\)` has no value, but"):
        _ = load_texts(Texts(LIFT, goal)).model


def test_a_number_that_is_missing_starts_at_0_with_a_warning():
    domain = load_texts(Texts(LIFT, FLOORS.format("(= (time f0 f3) 6)")))
    assert domain.model.values(domain.model.initial_state)["cost"] == 0.0
    (warning,) = domain.warnings
    assert warning.text == "`cost` starts at 0, because :init gives no value"
    stated = load_texts(Texts(LIFT, FLOORS.format("(= (time f0 f3) 6) (= (cost) 2)")))
    assert stated.model.initial_state is not None and not stated.warnings


def test_a_chain_of_deletions_is_followed_link_by_link(monkeypatch):
    """However the links are ordered, the effort grows with their number, not with its square."""
    asked = []
    varies = Facts.varies
    monkeypatch.setattr(Facts, "varies", lambda facts, key: asked.append(key) or varies(facts, key))
    links = 400
    domain = """(define (domain doors) (:predicates (beside ?a ?b) (shut ?a))
      (:action open :parameters (?a ?b)
        :precondition (and (beside ?a ?b) (not (shut ?a))) :effect (not (shut ?b))))"""
    doors = [f"d{k:03}" for k in range(links + 1)]
    beside = " ".join(f"(beside {a} {b}) (shut {b})" for b, a in itertools.pairwise(doors))
    problem = f"(define (problem p) (:domain doors) (:objects {' '.join(doors)}) (:init {beside}))"
    assert len(load_texts(Texts(domain, problem)).model.actions) == links
    assert len(asked) < 20 * links


@pytest.mark.parametrize(
    ("condition", "leads"),
    [
        ("(and (p1) (q))", False),  # nothing makes q true
        ("(and (p1) (not (q)))", True),
        ("(or (q) (p1))", True),  # first neither holds, then one does
        ("(imply (start) (p1))", True),
        ("(and (p1) (not (start)))", True),  # `start` is deleted
        ("(exists (?o) (and (mark ?o) (not (= ?o b))))", True),  # through a conditional effect
        ("(exists (?o) (and (mark ?o) (= ?o b)))", False),
        ("(forall (?o) (mark ?o))", False),
        ("(forall (?o) (or (mark ?o) (= ?o b)))", True),
        ("(> (count) 1000000)", True),  # numbers rule nothing out
    ],
)
def test_what_leads_to_an_action_may_itself_have_to_be_reached(condition, leads):
    texts = Texts(
        "(define (domain d) (:constants a b) (:functions (count))"
        " (:predicates (start) (p0) (p1) (q) (mark ?o))"
        f" (:action last :precondition {condition} :effect (increase (count) 1))"
        " (:action third :effect (forall (?o) (when (and (p1) (not (= ?o b))) (mark ?o))))"
        " (:action second :precondition (p0) :effect (and (p1) (not (start)) (not (q))))"
        " (:action first :precondition (start) :effect (p0)))",
        "(define (problem p) (:domain d) (:init (start) (= (count) 0)))",
    )
    names = [action.name for action in load_texts(texts).model.actions]
    assert names == [*(["last"] if leads else []), "third", "second", "first"]


@given(models_with_states(count=4))
@examples(60)
def test_what_is_left_out_never_happens_and_what_is_fixed_is_as_stated(drawn):
    """In every state where they are observed, else in those that `:init` leads to."""
    generated, states = drawn
    model, oracle = generated.model, generated.oracle
    every = list(oracle.instances(x.Kind.ACTION))
    kept = [action.name for action in model.actions]
    assert [name for name in every if name in set(kept)] == kept  # the order of the file
    initial = {key: 0.0 for key in oracle.terms()} | oracle.initial()
    fixed = {tuple(name.split()): value for name, value in model.ground.static.items()}
    assert all(initial[key] == value for key, value in fixed.items())
    columns = {fluent.key: fluent.numeric for fluent in model.fluents}
    assert not fixed.keys() & columns.keys()
    wider = generated.domain.observed().model
    assert columns.keys() <= {fluent.key for fluent in wider.fluents}
    static = {name for name, *_ in oracle.terms()} - {f.symbol for f in wider.fluents}
    changed = {t for action in wider.actions for t in writes(action) if t >= 0}
    assert not static & {wider.fluents[t].symbol for t in changed}
    terms = {key: kind for key, kind in oracle.terms().items() if key[0] not in static}
    assert {fluent.key: fluent.numeric for fluent in wider.fluents} == terms
    if model.initial_state is not None:
        assert model.initial_state.tolist() == [float(initial[f.key]) for f in model.fluents]
        states = np.concatenate((states, walk(generated, model.initial_state)))
    for state in states:
        spelled = generated.spelled(state)
        for name in set(every) - set(kept):
            assert not oracle.step(spelled, name).applicable


def walk(generated, state):
    """The states of a random walk of a few steps."""
    random, model, states = Random(0), generated.model, [state]
    for _ in range(5):
        outcomes = [model.step(states[-1], k) for k in range(len(model.actions))]
        possible = [outcome.state for outcome in outcomes if outcome.applicable]
        if not possible:
            break
        states.append(random.choice(possible))
    return np.array(states)
