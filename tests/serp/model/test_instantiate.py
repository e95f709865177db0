"""Instances and columns: which there are, and when there would be too many."""

import time

import pytest

from serp.model.domain import Domain
from serp.pddl.source import DomainError, Source

EIGHT = "(?a ?b ?c ?d ?e ?f ?g ?h)"


def with_objects(domain, count, init=""):
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
            "more than 2000 fluents",
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
    ],
    ids=["actions", "fluents", "bindings"],
)
def test_millions_of_instances_are_refused_at_once_with_the_reason(domain, init, says, advises):
    many = with_objects(domain, 30, init)
    started = time.process_time()
    with pytest.raises(DomainError) as caught:
        _ = many.model
    assert time.process_time() - started < 2.0  # 0.2 s on an idle machine
    assert says in caught.value.problem and advises in caught.value.advice
    assert caught.value.line == 1


def test_what_holds_for_all_objects_is_worked_out_once_for_all_instances():
    model = with_objects(
        "(:predicates (p ?a) (q ?a ?b)) (:action go :parameters (?a ?b)"
        " :precondition (forall (?c ?d) (not (q ?c ?d)))"
        " :effect (and (forall (?c ?d) (p ?c)) (forall (?d) (q ?b ?d)) (q ?a ?b)))",
        30,  # 900 instances, of 900 bindings each
    ).model
    assert (len(model.fluents), len(model.actions)) == (30 + 900, 900)
