"""Instances and columns: which there are, and when there would be too many."""

from __future__ import annotations

import time

import pytest

from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel
from serp.pddl.source import DomainError, Source
from tests.generated import Texts, load_texts

EIGHT = "(?a ?b ?c ?d ?e ?f ?g ?h)"


def with_objects(domain: str, count: int, init: str = "") -> Domain:
    """A domain over so many objects, with low limits."""
    objects = " ".join(f"o{k}" for k in range(count))
    source = Source("many.pddl", f"(define (domain many) {domain})")
    problem = f"(define (problem p) (:objects {objects}) (:init {init}))"
    return Domain.parse(source, Source("many-problem.pddl", problem), max_ground_schemas=2000)


@pytest.mark.parametrize(
    ("domain", "init", "says", "advises"),
    [
        (
            f"(:predicates (p ?a)) (:action go :parameters {EIGHT} :effect (p ?a))",
            "",
            "more than 2000 ground actions, processes and events; `go` has up to 6561",
            "use fewer objects, more specific types",
        ),
        (
            "(:predicates (p ?a ?b ?c ?d ?e)) (:action go"
            " :effect (forall (?a ?b ?c ?d ?e) (p ?a ?b ?c ?d ?e)))",
            "",
            "more than 8000 fluents",
            "use fewer objects",
        ),
        (  # all of them are ruled out, but only by the last parameter
            "(:predicates (p ?a) (static ?a ?h)) (:action go"
            f" :parameters {EIGHT} :precondition (and (not (static ?h ?h)) (not (static ?a ?h)))"
            " :effect (p ?a))",
            " ".join(f"(static o{a} o{h})" for a in range(30) for h in range(30)),
            "more than 40000 bindings",
            "use fewer objects",
        ),
        (
            "(:predicates (p ?a)) (:action go :effect (forall (?u ?v ?w ?x ?y ?z) (p ?u)))",
            "",
            "more than 40000 bindings",
            "fewer parameters and quantifiers",
        ),
        (
            "(:constants o) (:predicates (p ?a)) (:action go"
            " :effect (when (exists (?u ?v ?w ?x ?y) (p ?u)) (p o)))",
            "",
            "more than 40000 bindings",
            "fewer parameters and quantifiers",
        ),
    ],
    ids=["actions", "fluents", "bindings", "effects", "conditions"],
)
def test_millions_of_instances_are_refused_at_once_with_the_reason(
    domain: str, init: str, says: str, advises: str
) -> None:
    many = with_objects(domain, 30, init)
    started = time.process_time()
    with pytest.raises(DomainError) as caught:
        _ = many.model
    assert time.process_time() - started < 2.0  # 0.2 s on an idle machine
    assert says in caught.value.problem and advises in caught.value.advice
    assert caught.value.line == 1


def test_static_facts_keep_large_domains_small() -> None:
    many = with_objects(
        "(:predicates (next ?a ?b) (at ?a)) (:action go :parameters (?a ?b ?c ?d)"
        " :precondition (and (next ?a ?b) (next ?b ?c) (next ?c ?d) (at ?a))"
        " :effect (and (at ?d) (not (at ?a))))",
        100,
        " ".join(f"(next o{k} o{k + 1})" for k in range(99)),
    )
    model = many.observed().model
    assert len(model.actions) == 97
    assert len(model.fluents) == 100


DOMAIN = (
    "(define (domain d) (:types room hall - place place) (:constants lobby - hall)"
    " (:predicates (at ?p - place) (lit ?p - room) (open)) (:functions (size ?p - place))"
    " (:action go :parameters (?p - place) :precondition (and (open) (> (size ?p) 2))"
    "  :effect (at ?p)))"
)


def names(texts: Texts) -> tuple[list[str], list[str], TransitionModel]:
    model = load_texts(texts).model
    return [a.name for a in model.actions], [f.name for f in model.fluents], model


def test_without_a_problem_the_constants_are_the_objects() -> None:
    actions, fluents, model = names(Texts(DOMAIN, None))
    assert actions == ["go lobby"]
    assert fluents == ["at lobby", "open", "size lobby"]
    assert model.initial_state is None


def test_what_nothing_states_and_nothing_changes_is_false_unless_states_are_observed() -> None:
    problem = "(define (problem p) (:domain d) (:objects r1 r2 - room) (:init (at r1)))"
    actions, fluents, model = names(Texts(DOMAIN, problem))
    sizes = ["size lobby", "size r1", "size r2"]  # numbers have no such value
    assert (actions, fluents) == ([], sizes)  # without `open` nobody goes anywhere
    assert model.ground.static == {"at r1": 1.0}
    observed = load_texts(Texts(DOMAIN, problem)).observed().model
    assert [a.name for a in observed.actions] == ["go lobby", "go r1", "go r2"]
    assert [f.name for f in observed.fluents] == [
        *("at lobby", "at r1", "at r2", "lit r1", "lit r2", "open", *sizes)
    ]
    assert observed.initial_state is None  # the sizes are left to the observation


def test_what_is_stated_and_never_changed_is_static() -> None:
    problem = (
        "(define (problem p) (:domain d) (:objects r1 - room)"
        " (:init (open) (= (size lobby) 1) (= (size r1) 3)))"
    )
    actions, fluents, model = names(Texts(DOMAIN, problem))
    assert fluents == ["at lobby", "at r1"]
    assert model.ground.static == {"open": 1.0, "size lobby": 1.0, "size r1": 3.0}
    assert actions == ["go lobby", "go r1"]  # a number may be corrected, so it rules out nothing
    assert model.initial_state is not None
    assert [model.step(model.initial_state, k).applicable for k in (0, 1)] == [False, True]
    roles = {(p.place.text, p.role) for p in model.parameters}
    assert roles == {("1", "initial"), ("3", "initial"), ("2", "condition")}
    larger = model.replace(
        theta=[5.0 if p.place.text == "1" else p.value for p in model.parameters]
    )
    assert larger.step(model.initial_state, 0).applicable


def test_parameters_carry_their_roles() -> None:
    model = load_texts(
        Texts(
            "(define (domain d) (:functions (x) (y))"
            " (:action a :precondition (> (x) 1) :effect (when (< (x) 2) (increase (x) 3)))"
            " (:process p :effect (increase (x) (* #t 4)))"
            " (:event e :precondition (> (x) 5) :effect (assign (x) 6)))",
            "(define (problem p) (:init (= (x) 0) (= (y) 8)) (:goal (< (x) 7))"
            " (:metric maximize (* 9 (x))))",
        )
    ).model
    assert {p.value: p.role for p in model.parameters} == {
        **{1: "condition", 2: "condition", 3: "effect", 4: "rate", 5: "condition", 6: "effect"},
        **{7: "condition", 9: "metric", 1e6: "goal"},
    }
