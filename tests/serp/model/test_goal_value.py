"""A goal beside a metric: the goal comes first."""

import pytest
from hypothesis import given

from serp.model.grounder import GoalValue
from serp.planning.replanner import MonitorReplanner
from tests.generated import Texts, examples, load_texts, models_with_states
from tests.worlds import text

DOMAIN = text("trip")
PROBLEM = """(define (problem p) (:domain trip) (:objects a b c d)
  (:init (at a) (road a b) (road b d) (road a c) (road c d) (= (load) 0) (= (cost) 0)
    (= (toll a b) 40) (= (toll b d) 40) (= (toll a c) 30) (= (toll c d) 45))
  (:goal (at d)) (:metric {}))"""


def model_of(metric, domain=DOMAIN):
    return load_texts(Texts(domain, PROBLEM.format(metric))).model


def test_the_planner_reaches_the_goal_in_spite_of_a_metric_and_by_the_best_way():
    model = model_of("minimize (cost)")
    plan = MonitorReplanner(model, depth=4).plan(model.initial_state)
    assert model.actions[plan.action].name == "drive a c"  # 75 and not 80; to idle costs nothing
    arrived = model.step(model.step(model.initial_state, "drive a c").state, "drive c d")
    assert arrived.terminal and arrived.reward == model.theta[-1] - 45


@pytest.mark.parametrize(
    ("metric", "worth"),
    [
        ("minimize (cost)", 1 + 100 * (45 + 3 * 0.5)),
        ("maximize (cost)", 1 + 100 * (45 + 3 * 0.5)),
        ("minimize (- (/ (cost) 2) (* 4 (total-time)))", 1 + 100 * (22.5 + 1.5 * 0.5 + 4 * 0.5)),
        ("minimize (total-time)", 1 + 100 * 0.5),
        ("minimize (* (cost) (cost))", 1_000_000),
    ],
)
def test_the_goal_is_worth_more_than_a_hundred_steps_can_gain(metric, worth):
    assert model_of(metric).replace(dt=0.5).theta[-1] == worth


def test_a_metric_without_bounds_is_warned_of():
    heavy = DOMAIN.replace("idle :effect (and)", "idle :effect (increase (load) (cost))")
    heavy = heavy.replace("(toll ?x ?y)))", "(load)))")
    texts = Texts(heavy, PROBLEM.format("minimize (cost)"))
    domain = load_texts(texts)
    assert domain.model.theta[-1] == 1_000_000
    (warning,) = domain.warnings
    assert "goal is worth 1,000,000" in warning.text
    assert not load_texts(Texts(DOMAIN, PROBLEM.format("minimize (cost)"))).warnings


@given(models_with_states())
@examples(60)
def test_no_step_of_any_domain_gains_more_than_the_bound(drawn):
    generated, states = drawn
    model = generated.model
    bounded = GoalValue(model.ground).bounded if model.ground.goal_parameter else None
    if bounded is None or not bounded(model.theta.tolist(), 1.0):
        return
    for state in states:
        for action in range(len(model.actions)):
            outcome = model.step(state, action)
            if not outcome.terminal and abs(state).max(initial=0.0) < 1e6:
                assert abs(outcome.reward) * 100 <= model.theta[-1] + 1e-6
