"""Rules find what a right domain may have forgotten, and say nothing of what is meant."""

from pathlib import Path

import pytest
from hypothesis import given

from serp.authoring.lint.conditions import contradiction
from serp.model.flags import APPLICABLE
from serp.model.transition_model import Vector
from serp.pddl.source import Source
from tests.generated.models import Generated, load_texts, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import Texts
from tests.serp.authoring.lint.found import findings_of
from tests.serp.ui.cli.conftest import WALK, WALK_PROBLEM

ROOT = Path(__file__).resolve().parents[4]


def warned(domain: str, problem: str = WALK_PROBLEM) -> list[str]:
    findings = findings_of(Source("d.pddl", domain), Source("p.pddl", problem))
    return [finding.rendered for finding in findings]


@pytest.mark.parametrize("file", sorted((ROOT / "domains").glob("*.pddl")), ids=lambda p: p.name)
def test_of_what_is_shipped_nothing_is_left_to_say(file: Path) -> None:
    if not file.stem.endswith("-problem"):
        assert [finding.rendered for finding in findings_of(file)] == []


def test_a_metric_is_a_reward() -> None:
    text = WALK.replace("(decrease (reward) 1)", "").replace("(increase (reward) 3)", "")
    text = text.replace("(walked) (reward)", "(walked)")
    problem = WALK_PROBLEM.replace("(:goal (and))", "(:metric minimize (walked))")
    assert warned(text, problem) == []


def test_what_a_bare_name_reads_is_used() -> None:
    text = WALK.replace("(> (walked) 0)", "(> slept 0)").replace("(walked) (", "slept (")
    text = text.replace("(walked)", "slept").replace("(> (walked)", "(> slept")
    found = warned(text, WALK_PROBLEM.replace("(= (walked) 0)", "(= slept 0)"))
    assert not [words for words in found if "nothing changes or reads it" in words], found


def test_waiting_is_an_action_where_the_world_moves() -> None:
    idle = "(:action idle :parameters () :precondition (and) :effect (and))"
    process = "(:process p :parameters () :precondition (and) :effect (and (increase (walked) #t)))"
    text = WALK.replace("(:action rest", idle + process + "(:action rest")
    assert warned(text.replace(":typing", ":typing :processes")) == []


BLOCKS = """
(define (domain blocks)
  (:requirements :adl)
  (:predicates (clear ?x) (on ?x ?y) (done))
  (:action move
    :parameters (?what ?from ?to)
    :precondition (and (clear ?what) (clear ?to) (on ?what ?from)
                       (or (done) (forall (?b) (clear ?b)) (exists (?b) (not (clear ?b)))))
    :effect (and (not (clear ?to)) (on ?what ?to) (clear ?from) (done))))
"""
BLOCKS_PROBLEM = """
(define (problem p) (:domain blocks) (:objects {objects})
  (:init (clear b1) (on b1 b1)) (:goal (and (done))))
"""


@pytest.mark.parametrize("objects", ["b1", "b1 b2"])
def test_what_comes_of_few_objects_is_no_finding(objects: str) -> None:
    problem = Source("p.pddl", BLOCKS_PROBLEM.format(objects=objects))
    found = findings_of(Source("d.pddl", BLOCKS), problem)
    assert [f.rendered for f in found if f.severity != "note"] == []


def test_a_domain_that_waits_for_its_problem_is_told_so_once() -> None:
    (found,) = (f for f in findings_of(Source("d.pddl", BLOCKS)) if f.severity != "note")
    assert found.code == "no-action"
    assert "give the problem file" in found.advice


def test_a_goal_that_is_not_known_may_read_anything() -> None:
    text = """(define (domain car) (:requirements :numeric-fluents) (:functions (way))
      (:action go :parameters () :precondition (and) :effect (and (increase (way) 1))))"""
    assert {f.code for f in findings_of(Source("d.pddl", text))} == {"no-reward"}


@given(models_with_states(count=4))
@examples(150)
def test_an_action_whose_conditions_exclude_each_other_is_applicable_nowhere(
    drawn: tuple[Generated, Vector],
) -> None:
    generated, states = drawn
    model = generated.model
    theta = model.theta.tolist()
    for index, action in enumerate(model.actions):
        if contradiction(action.preconditions, theta):
            for state in states.tolist():
                assert not model.transition(state, index)[1] & APPLICABLE


@pytest.mark.parametrize(
    ("condition", "never"),
    [
        ("(> (atan2 (x) (y)) 90)", True),  # degrees
        ("(< (* 2 (abs (x))) -1)", True),
        ("(= (+ (sin (x)) 1) 2.5)", True),
        ("(not (>= (sqrt (x)) 0))", True),
        ("(> (max 1 (- 7 (abs -2))) (- (+ (x) 4) (x)))", False),
        ("(< (max 1 (- 7 (abs -2))) (- (+ (x) 4) (x)))", True),
        ("(> (cos (x)) -1)", False),
        ("(not (= (sqrt (x)) -1))", False),
        ("(and (> (x) 3) (or (= (x) 2) (not (> (x) 3))))", True),
        ("(and (= (x) 3) (not (= (x) 3)))", True),
        ("(and (<= (x) 3) (>= (x) 3))", False),
        ("(and (> (x) 3) (or (= (x) 2) (> (x) 4)))", False),
        ("(and (> (* (x) (x)) 3) (< (x) -1))", False),
    ],
)
def test_what_a_function_never_gives_is_known(condition: str, never: bool) -> None:
    text = f"""(define (domain d) (:requirements :math-functions) (:functions (x) (y))
      (:action a :precondition {condition}))"""
    model = load_texts(Texts(text, None)).model
    tests = model.ground.actions[0].preconditions
    assert (contradiction(tests, model.theta.tolist()) is not None) == never
