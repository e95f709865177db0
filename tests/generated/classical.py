"""Blocks and gripper of any size, as texts that every planner for PDDL reads."""

from random import Random

from tests.generated.writer import Texts

BLOCKS = """(define (domain blocks)
  (:predicates (on ?x ?y) (table ?x) (clear ?x) (empty) (holding ?x))
  (:action pick-up :parameters (?x) :precondition (and (clear ?x) (table ?x) (empty))
    :effect (and (not (table ?x)) (not (clear ?x)) (not (empty)) (holding ?x)))
  (:action put-down :parameters (?x) :precondition (and (holding ?x))
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


def blocks(count: int, seed: int = 0) -> Texts:
    """Blocks that stand in random towers, and other towers that are to be built of them."""
    random, names = Random(seed), [f"b{k}" for k in range(count)]
    init, goal = (" ".join(_towers(random, names)) for _ in range(2))
    return Texts(BLOCKS, _problem("blocks", " ".join(names), f"(empty) {init}", goal))


def _towers(random: Random, names: list[str]) -> list[str]:
    order, facts = random.sample(names, len(names)), []
    for k, name in enumerate(order):
        on_table = k == 0 or random.random() < 0.3
        facts.append(f"(table {name})" if on_table else f"(on {name} {order[k - 1]})")
        if on_table and k:
            facts.append(f"(clear {order[k - 1]})")
    return [*facts, f"(clear {order[-1]})"]


def gripper(balls: int) -> Texts:
    """Two rooms, two grippers, and balls to be brought from one to the other."""
    names = [f"ball{k}" for k in range(balls)]
    init = "(room a) (room b) (gripper left) (gripper right) (robby a) (free left) (free right) "
    init += " ".join(f"(ball {b}) (at {b} a)" for b in names)
    goal = " ".join(f"(at {b} b)" for b in names)
    return Texts(GRIPPER, _problem("gripper", " ".join(["a b left right", *names]), init, goal))


def _problem(name: str, objects: str, init: str, goal: str) -> str:
    return (
        f"(define (problem {name}-1) (:domain {name}) (:objects {objects})\n"
        f"  (:init {init})\n  (:goal (and {goal})))"
    )
