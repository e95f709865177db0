"""What a replan costs in classical domains with 16 objects: blocks, gripper, logistics.

    python tests/benchmarks/bench_large.py [--rounds N] [--depth D]

Seconds from the text to the model, to the first decision of a new lookahead (loops are compiled
before), and of each replan along a walk through the domain; and the same of the planner
`far-sight`. Nothing is asserted. Run it with the code before and after a change, by turns.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import warnings
from time import perf_counter

import numpy as np

from serp.control.registry import make_planner
from serp.model.loading import Domain
from serp.model.transition_model import Vector
from serp.pddl.source import Source
from serp.settings import PlannerSettings, resolve

OBJECTS = 16

BLOCKS = """(define (domain blocks)
  (:predicates (on ?x ?y) (table ?x) (clear ?x) (empty) (holding ?x))
  (:action pick-up :parameters (?x) :precondition (and (clear ?x) (table ?x) (empty))
    :effect (and (not (table ?x)) (not (clear ?x)) (not (empty)) (holding ?x)))
  (:action put-down :parameters (?x) :precondition (holding ?x)
    :effect (and (not (holding ?x)) (clear ?x) (empty) (table ?x)))
  (:action stack :parameters (?x ?y) :precondition (and (holding ?x) (clear ?y))
    :effect (and (not (holding ?x)) (not (clear ?y)) (clear ?x) (empty) (on ?x ?y)))
  (:action unstack :parameters (?x ?y) :precondition (and (on ?x ?y) (clear ?x) (empty))
    :effect (and (holding ?x) (clear ?y) (not (clear ?x)) (not (empty)) (not (on ?x ?y)))))"""
GRIPPER = """(define (domain gripper)
  (:predicates (room ?r) (ball ?b) (gripper ?g) (robby ?r) (at ?b ?r) (free ?g) (carry ?o ?g))
  (:action move :parameters (?f ?t) :precondition (and (room ?f) (room ?t) (robby ?f))
    :effect (and (robby ?t) (not (robby ?f))))
  (:action pick :parameters (?o ?r ?g)
    :precondition (and (ball ?o) (room ?r) (gripper ?g) (at ?o ?r) (robby ?r) (free ?g))
    :effect (and (carry ?o ?g) (not (at ?o ?r)) (not (free ?g))))
  (:action drop :parameters (?o ?r ?g)
    :precondition (and (ball ?o) (room ?r) (gripper ?g) (carry ?o ?g) (robby ?r))
    :effect (and (at ?o ?r) (free ?g) (not (carry ?o ?g)))))"""
LOGISTICS = """(define (domain logistics)
  (:predicates (parcel ?o) (van ?v) (place ?p) (road ?p ?q) (at ?o ?p) (in ?o ?v))
  (:action load :parameters (?o ?v ?p)
    :precondition (and (parcel ?o) (van ?v) (place ?p) (at ?v ?p) (at ?o ?p))
    :effect (and (not (at ?o ?p)) (in ?o ?v)))
  (:action unload :parameters (?o ?v ?p)
    :precondition (and (parcel ?o) (van ?v) (place ?p) (at ?v ?p) (in ?o ?v))
    :effect (and (not (in ?o ?v)) (at ?o ?p)))
  (:action drive :parameters (?v ?p ?q)
    :precondition (and (van ?v) (place ?p) (place ?q) (at ?v ?p) (road ?p ?q))
    :effect (and (not (at ?v ?p)) (at ?v ?q))))"""


def problem(name: str, objects: list[str], init: str, goal: str) -> str:
    return (
        f"(define (problem p) (:domain {name}) (:objects {' '.join(objects)})"
        f" (:init {init}) (:goal (and {goal})))"
    )


def blocks() -> tuple[str, str]:
    """All blocks lie on the table; the goal is one tower."""
    names = [f"b{k}" for k in range(OBJECTS)]
    init = "(empty) " + " ".join(f"(table {b}) (clear {b})" for b in names)
    goal = " ".join(f"(on {a} {b})" for a, b in itertools.pairwise(names))
    return BLOCKS, problem("blocks", names, init, goal)


def gripper() -> tuple[str, str]:
    """Two rooms, two grippers, the others are balls."""
    balls = [f"ball{k}" for k in range(OBJECTS - 4)]
    init = "(room a) (room b) (gripper left) (gripper right) (robby a) (free left) (free right) "
    init += " ".join(f"(ball {b}) (at {b} a)" for b in balls)
    goal = " ".join(f"(at {b} b)" for b in balls)
    return GRIPPER, problem("gripper", ["a", "b", "left", "right", *balls], init, goal)


def logistics() -> tuple[str, str]:
    """Two vans, six places in a ring, eight parcels."""
    places, parcels = [f"p{k}" for k in range(6)], [f"o{k}" for k in range(OBJECTS - 8)]
    init = "(van v0) (van v1) (at v0 p0) (at v1 p3) " + " ".join(f"(place {p})" for p in places)
    for k in range(6):
        init += f" (road p{k} p{(k + 1) % 6}) (road p{(k + 1) % 6} p{k})"
    init += "".join(f" (parcel {o}) (at {o} p{k % 6})" for k, o in enumerate(parcels))
    goal = " ".join(f"(at {o} p{(3 * k + 1) % 6})" for k, o in enumerate(parcels))
    return LOGISTICS, problem("logistics", ["v0", "v1", *places, *parcels], init, goal)


def walk(domain: Domain, steps: int) -> list[Vector]:
    """Return the states on a random walk."""
    model, random = domain.model, np.random.default_rng(0)
    assert model.initial_state is not None
    states = [model.initial_state]
    while len(states) < steps:
        action = int(random.integers(len(model.actions)))
        target, flags = model.transition(states[-1].tolist(), action)
        if flags & 1:
            states.append(np.array(target[:-1]))
    return states


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--depth", type=int, default=3)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    near = PlannerSettings(depth=options.depth)
    far = resolve("default").planner.replace(name="far-sight")
    small = Domain.parse(Source("d", BLOCKS), Source("p", problem("blocks", ["b"], "", "(on b b)")))
    for settings in (near, far):
        make_planner(small.model, settings).forecast(np.zeros(len(small.model.fluents)))
    for name, (text, made) in {
        "blocks": blocks(), "gripper": gripper(), "logistics": logistics(),
    }.items():  # fmt: skip
        start = perf_counter()
        domain = Domain.parse(Source(f"{name}.pddl", text), Source(f"{name}-problem.pddl", made))
        model = domain.model
        loading = perf_counter() - start
        states = walk(domain, options.rounds + 1)
        start = perf_counter()
        planner = make_planner(model, near)
        planner.forecast(states[0])
        first = perf_counter() - start
        times = []
        for state in states[1:]:
            start = perf_counter()
            planner.forecast(state)
            times.append(perf_counter() - start)
        start = perf_counter()
        seeing = make_planner(model, far)
        seeing.forecast(states[0])
        whole = perf_counter() - start
        print(
            f"{name:<10}{len(model.actions):>5} actions{len(model.fluents):>5} fluents"
            f"  load {loading:.3f} s  first {first:.3f} s"
            f"  replan {1e3 * statistics.median(times):.2f} ms  first decision {whole:.2f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
