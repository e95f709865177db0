"""Rules find what a right domain may have forgotten, and say nothing of what is meant."""

import pytest
from hypothesis import given

from serp.authoring.lint.contradiction import contradiction
from serp.authoring.lint.findings import examine
from serp.model.flags import APPLICABLE
from serp.pddl.source import Source
from tests.generated.models import load_texts, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import Texts
from tests.serp.ui.cli.conftest import WALK, WALK_PROBLEM
from tests.worlds import DOMAINS, text


def warned(domain, problem=WALK_PROBLEM):
    findings = examine(Source("d.pddl", domain), Source("p.pddl", problem)).findings
    return [finding.rendered for finding in findings]


@pytest.mark.parametrize("file", sorted(DOMAINS.glob("*.pddl")), ids=lambda p: p.name)
def test_of_what_is_shipped_nothing_is_left_to_say(file):
    if not file.stem.endswith("-problem"):
        assert [finding.rendered for finding in examine(file).findings] == []


def test_a_metric_is_a_reward():
    text = WALK.replace("(decrease (reward) 1)", "").replace("(increase (reward) 3)", "")
    text = text.replace("(walked) (reward)", "(walked)")
    problem = WALK_PROBLEM.replace("(:goal (and))", "(:metric minimize (walked))")
    assert warned(text, problem) == []


def test_waiting_is_an_action_where_the_world_moves():
    idle = "(:action idle :parameters () :precondition (and) :effect (and))"
    process = "(:process p :parameters () :precondition (and) :effect (and (increase (walked) #t)))"
    text = WALK.replace("(:action rest", idle + process + "(:action rest")
    assert warned(text.replace(":typing", ":typing :processes")) == []


BLOCKS = text("few-blocks")
BLOCKS_PROBLEM = """
(define (problem p) (:domain blocks) (:objects {objects})
  (:init (clear b1) (on b1 b1)) (:goal (and (done))))
"""


@pytest.mark.parametrize("objects", ["b1", "b1 b2"])
def test_what_comes_of_few_objects_is_no_finding(objects):
    problem = Source("p.pddl", BLOCKS_PROBLEM.format(objects=objects))
    found = examine(Source("d.pddl", BLOCKS), problem).findings
    assert [f.rendered for f in found if f.severity != "note"] == []


@given(models_with_states(count=4))
@examples(60)
def test_an_action_whose_conditions_exclude_each_other_is_applicable_nowhere(drawn):
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
        ("(> (max 1 (- 7 (abs -2))) (- (+ (x) 4) (x)))", False),
        ("(not (= (sqrt (x)) -1))", False),
        ("(and (> (x) 3) (or (= (x) 2) (not (> (x) 3))))", True),
        ("(and (<= (x) 3) (>= (x) 3))", False),
        ("(and (> (x) 3) (or (= (x) 2) (> (x) 4)))", False),
        ("(and (> (* (x) (x)) 3) (< (x) -1))", False),
    ],
)
def test_what_a_function_never_gives_is_known(condition, never):
    text = f"""(define (domain d) (:requirements :math-functions) (:functions (x) (y))
      (:action a :precondition {condition}))"""
    model = load_texts(Texts(text, None)).model
    tests = model.ground.actions[0].preconditions
    assert (contradiction(tests, model.theta.tolist()) is not None) == never
