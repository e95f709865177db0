"""Blocks, gripper and logistics of any size, as texts that every planner for PDDL reads."""

from __future__ import annotations

import itertools
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
LOGISTICS = """(define (domain logistics)
  (:requirements :strips :typing)
  (:types thing place city - object vehicle parcel - thing truck plane - vehicle airport - place)
  (:predicates (at ?x - thing ?p - place) (in ?o - parcel ?v - vehicle) (part ?p - place ?c - city))
  (:action load :parameters (?o - parcel ?v - vehicle ?p - place)
    :precondition (and (at ?v ?p) (at ?o ?p)) :effect (and (not (at ?o ?p)) (in ?o ?v)))
  (:action unload :parameters (?o - parcel ?v - vehicle ?p - place)
    :precondition (and (at ?v ?p) (in ?o ?v)) :effect (and (not (in ?o ?v)) (at ?o ?p)))
  (:action drive :parameters (?v - truck ?p - place ?q - place ?c - city)
    :precondition (and (at ?v ?p) (part ?p ?c) (part ?q ?c))
    :effect (and (not (at ?v ?p)) (at ?v ?q)))
  (:action fly :parameters (?v - plane ?p - airport ?q - airport)
    :precondition (and (at ?v ?p)) :effect (and (not (at ?v ?p)) (at ?v ?q))))"""


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


def logistics(cities: int, parcels: int, seed: int = 0, *, places: int = 3) -> Texts:
    """Cities with a truck and some places each, one an airport; parcels from anywhere to anywhere.

    There is a plane for every four cities.
    """
    random, planes = Random(seed), 1 + cities // 4
    spots = [f"p{c}-{k}" for c, k in itertools.product(range(cities), range(places))]
    objects = f"{' '.join(f'c{c}' for c in range(cities))} - city "
    objects += f"{' '.join(f't{c}' for c in range(cities))} - truck "
    objects += f"{' '.join(f'a{k}' for k in range(planes))} - plane "
    objects += f"{' '.join(f'o{k}' for k in range(parcels))} - parcel "
    objects += f"{' '.join(s for s in spots if s.endswith('-0'))} - airport "
    objects += f"{' '.join(s for s in spots if not s.endswith('-0'))} - place"
    init = " ".join(f"(part {spot} c{spot[1:].split('-')[0]})" for spot in spots)
    init += "".join(f" (at t{c} p{c}-{c % places})" for c in range(cities))
    init += "".join(f" (at a{k} p{k % cities}-0)" for k in range(planes))
    init += "".join(f" (at o{k} {random.choice(spots)})" for k in range(parcels))
    goal = " ".join(f"(at o{k} {random.choice(spots)})" for k in range(parcels))
    return Texts(LOGISTICS, _problem("logistics", objects, init, goal))


def _problem(name: str, objects: str, init: str, goal: str) -> str:
    return (
        f"(define (problem {name}-1) (:domain {name}) (:objects {objects})\n"
        f"  (:init {init})\n  (:goal (and {goal})))"
    )
