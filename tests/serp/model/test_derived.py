"""Derived predicates hold where the least fixed point of their axioms does."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.domain import Domain
from serp.model.flags import APPLICABLE
from serp.pddl.source import DomainError, Source
from tests.generated.profile import examples

BLOCKS = "abcd"
TOWER = """(define (domain tower) (:requirements :typing :derived-predicates)
  (:types block) (:predicates (on ?x ?y - block) (above ?x ?y - block) (free ?x - block) (done))
  {}
  (:action put :parameters (?x ?y - block) :precondition (and) :effect (on ?x ?y))
  (:action lift :parameters (?x ?y - block) :precondition (and) :effect (not (on ?x ?y)))
  (:action see :parameters (?x ?y - block) :precondition (above ?x ?y) :effect (done))
  (:action touch :parameters (?x - block) :precondition (free ?x) :effect (done)))"""
AXIOMS = """(:derived (above ?x ?y) (on ?x ?y))
  (:derived (above ?x ?y) (exists (?z - block) (and (on ?x ?z) (above ?z ?y))))
  (:derived (free ?x) (not (exists (?y - block) (above ?y ?x))))"""
PROBLEM = Source("p.pddl", "(define (problem p) (:domain tower) (:objects a b c d - block) {})")


def tower(axioms=AXIOMS, more=""):
    problem = Source("p.pddl", PROBLEM.text.format(f"(:init {more})"))
    return Domain.parse(Source("tower.pddl", TOWER.format(axioms)), problem)


MODEL = tower().model
PAIRS = list(itertools.product(BLOCKS, repeat=2))


@examples(100)
@given(st.sets(st.sampled_from(PAIRS)))
def test_a_recursive_predicate_is_the_transitive_closure(on):
    closure = set(on)
    for _ in BLOCKS:
        closure |= {(x, w) for (x, y), (z, w) in itertools.product(closure, on) if y == z}
    values = {f.name: 0.0 for f in MODEL.fluents} | {f"on {x} {y}": 1.0 for x, y in on}
    state = MODEL.state(values)
    for x, y in PAIRS:
        _, flags = MODEL.transition(state.tolist(), MODEL.action_index(f"see {x} {y}"))
        assert bool(flags & APPLICABLE) == ((x, y) in closure)
        assert flags == MODEL.trace(state, MODEL.action_index(f"see {x} {y}"))[1]
    for x in BLOCKS:
        _, flags = MODEL.transition(state.tolist(), MODEL.action_index(f"touch {x}"))
        assert bool(flags & APPLICABLE) == all(lower != x for _, lower in closure)


def test_a_derived_predicate_is_no_part_of_the_state():
    assert {f.symbol for f in MODEL.fluents} == {"on", "done"}
    assert tower().declared("above a b") is None
    assert np.isfinite(MODEL.state({f.name: 0.0 for f in MODEL.fluents})).all()


def test_what_follows_from_facts_that_never_change_is_static():
    text = """(define (domain map) (:requirements :derived-predicates)
      (:predicates (road ?x ?y) (way ?x ?y) (at ?x))
      (:derived (way ?x ?y) (or (road ?x ?y) (exists (?z) (and (road ?x ?z) (way ?z ?y)))))
      (:action go :parameters (?x ?y) :precondition (and (at ?x) (way ?x ?y))
        :effect (and (at ?y) (not (at ?x)))))"""
    problem = """(define (problem p) (:domain map) (:objects a b c)
      (:init (at a) (road a b) (road b c)))"""
    model = Domain.parse(Source("map.pddl", text), Source("p.pddl", problem)).model
    assert [a.name for a in model.actions] == ["go a b", "go a c", "go b c"]


@pytest.mark.parametrize(
    ("axioms", "more", "message"),
    [
        ("(:derived (free ?x) (not (free ?x)))", "", "depends on its own negation"),
        (
            "(:derived (free ?x) (not (above ?x ?x))) (:derived (above ?x ?y) (free ?x))",
            "",
            "depends on its own negation",
        ),
        ("(:derived (on ?x ?y) (above ?x ?y))", "", "`on` is derived, so no effect can set it"),
        (AXIOMS, "(above a b)", "`above` is derived, so :init cannot state it"),
        ("(:derived (above ?x) (on ?x ?x))", "", "cannot be derived"),
        ("(:derived (free ?x))", "", "`:derived` takes a predicate with its parameters"),
    ],
)
def test_a_mistake_is_named_with_its_place(axioms, more, message):
    with pytest.raises(DomainError, match=message) as refused:
        _ = tower(axioms, more).model
    assert "tower.pddl:" in str(refused.value) or "p.pddl:" in str(refused.value)


def test_too_many_ways_to_derive_are_refused():
    objects = " ".join(f"b{k}" for k in range(6))
    problem = Source("p.pddl", f"(define (problem p) (:domain tower) (:objects {objects} - block))")
    with pytest.raises(DomainError, match="has too many derivations over these objects"):
        _ = Domain.parse(Source("tower.pddl", TOWER.format(AXIOMS)), problem, observed=True).model
