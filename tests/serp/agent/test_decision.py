"""The account of a decision says what the model says, in the words of the file."""

from random import Random

import numpy as np
import pytest

from serp.agent.causes import causes_of, observed_causes
from serp.agent.counterfactuals import counterfactuals
from serp.agent.explanation import explain
from serp.agent.sentences import lines_of
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.model.learned.adapted_model import AdaptedModel
from serp.planning.forecast import SAFE, Bound, Forecast, score_of
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings
from tests.generated import PLANNABLE, Texts, generate, load_texts, random_states
from tests.serp.planning.worlds import WORLDS, states_of, world
from tests.worlds import text

HALL = text("hall")


@pytest.fixture(scope="module")
def hall():
    return load_texts(Texts(HALL, None)).model


def account(model, state, depth=2):
    plan = MonitorReplanner(model, depth=depth).plan(state)
    return explain(model, state, plan.forecast, plan.action, paths=plan.paths)


def one_step(model, state):
    """What a planner of depth 1 predicts, without compiling anything."""
    steps = [model.transition(state.tolist(), k) for k in range(len(model.actions))]
    outs, flags = [out for out, _ in steps], np.array([flag for _, flag in steps], dtype=int)
    there = flags & APPLICABLE > 0
    reward = np.where(there, [out[-1] for out in outs], 0.0)
    unsafe = there & (flags & UNSAFE > 0)
    steps = np.where(there, np.where(unsafe, 0, SAFE), -1)
    value = np.where(there, reward, -np.inf)
    risk = np.where(there & ~unsafe, 0.0, 1.0)
    return Forecast(-1, value, risk, steps, reward, flags, 1, Bound.DEPTH)


def test_the_parts_of_a_reward_add_up_to_it_and_flags_have_causes():
    """On generated domains: what is refused has a cause, nothing else has one, and none fails."""
    told = {"reward": 0, "unsafe": 0, "not applicable": 0}
    models = [(world(seed), states_of(world(seed), Random(seed), 6)) for seed in range(WORLDS)]
    for seed in range(60):
        random = Random(seed)
        model = generate(random, PLANNABLE).model
        models.append((model, random_states(random, model, 4)))
    for model, states in models:
        for state in states:
            for each in explain(model, state, one_step(model, state), None).alternatives:
                amounts = [c.amount or 0.0 for c in each.causes if c.what == "reward"]
                assert all(cause.origin != "learned" for cause in each.causes)
                assert sum(amounts) == pytest.approx(each.reward or 0.0, rel=1e-9, abs=1e-9)
                whats = {cause.what for cause in each.causes}
                if each.applicable:
                    assert ("unsafe" in whats) == each.unsafe == ("unsafe:" in each.remark)
                    assert ("end" in whats) == each.terminal == ("ends" in each.remark)
                else:
                    assert whats & {"failed", "conflict", "undefined"}
                    assert each.remark.startswith("not applicable: ")
                told["not applicable"] += not each.applicable
                told["unsafe"] += each.unsafe
                told["reward"] += len(amounts)
    assert min(told.values()) > 200


def test_causes_quote_the_file_with_comment_place_and_values(hall):
    walk, leap = account(hall, np.array([0.0, 2.5])).alternatives
    says = [(c.what, c.amount, c.origin, c.name, c.comment) for c in walk.causes]
    assert says == [
        ("reward", -0.5, "action", "walk", "one metre"),
        ("reward", -0.25, "process", "tire", ""),
        ("end", None, "event", "door", "it leads outside"),
        ("reward", 7.0, "event", "door", "it leads outside"),
    ]
    door = walk.causes[3]
    assert (door.text, door.condition) == ("(increase (reward) (* 2 (x)))", "(> (x) 3)")
    assert door.reads == {"x": 3.5} and walk.next_state == {"open": False, "x": 9.0}
    assert door.place is not None and (door.place.line, door.place.column) == (12, 18)
    assert "+7, the end of the task by event door: it leads outside." in lines_of(walk)[2]
    assert [c.what for c in leap.causes] == ["failed"] and leap.reward is None
    assert leap.causes[0].reads == {"open": False}


def test_goal_and_metric_are_causes_too():
    domain = """(define (domain d) (:predicates (there)) (:functions (total-cost))
      (:action go :parameters () :precondition (and)
        :effect (and (there) (increase (total-cost) 3))))"""
    problem = """(define (problem p) (:domain d) (:init (= (total-cost) 0))
      ; where it is warm
      (:goal (there))
      (:metric minimize (+ (* 2 (total-time)) (total-cost))))"""
    model = load_texts(Texts(domain, problem)).model
    causes = causes_of(model, model.initial_state, 0)
    rewards = [(c.origin, c.amount) for c in causes if c.what == "reward"]
    assert [origin for origin, _ in rewards] == ["action", "goal", "metric"]
    assert (rewards[0][1], rewards[2][1]) == (-3.0, pytest.approx(-2.0))
    step = model.step(model.initial_state, 0)
    assert sum(amount or 0.0 for _, amount in rewards) == pytest.approx(step.reward)
    assert [(c.what, c.comment) for c in causes][-1] == ("end", "where it is warm")
    observed, judged = observed_causes(model, model.initial_state, 0, step.state)
    parts = [cause.amount or 0.0 for cause in observed if cause.what == "reward"]
    assert sum(parts) == pytest.approx(judged.reward) and judged.reward == step.reward


def test_what_was_learned_is_a_cause_of_its_own(hall):
    adapted = AdaptedModel(hall)
    state = np.array([0.0, 0.0])
    forecast = Lookahead(adapted, PlannerSettings(depth=1)).forecast(state)
    learned = forecast._replace(reward=forecast.reward + 0.125)
    ends = learned._replace(flags=learned.flags | TERMINAL)
    causes = explain(adapted, state, ends, 0).alternatives[0].causes
    assert [c.origin for c in causes if c.what == "end"] == ["learned"]
    causes = explain(adapted, state, learned, 0).alternatives[0].causes
    assert [(c.origin, c.amount) for c in causes if c.origin == "learned"] == [("learned", 0.125)]
    assert sum(c.amount or 0.0 for c in causes) == learned.reward[0]


def test_the_runner_up_is_the_best_other_action():
    seen = set[str]()
    for seed in range(15):
        random = Random(seed)
        model = generate(random, PLANNABLE).model
        for state in random_states(random, model, 2):
            predicted = one_step(model, state)
            scores = {
                k: score_of(predicted, k) for k in np.flatnonzero(predicted.applicable).tolist()
            }
            for chosen in scores:
                found = explain(model, state, predicted, chosen).runner_up
                others = {k: score for k, score in scores.items() if k != chosen}
                assert (found is None) == (not others)
                if found is not None:
                    best = max(others.values())
                    assert others[found.action] == best
                    assert scores[chosen] == best or found.ahead == (scores[chosen] > best)
                    seen.add(found.by)
    assert {"value", "order", "rank"} <= seen


def test_the_smallest_change_that_tips_the_choice_is_found(hall):
    planner = Lookahead(hall, PlannerSettings(depth=1))
    state = np.array([1.0, 0.5])  # leaping costs less than walking
    ranges = np.array([0.0, -5.0]), np.array([1.0, 5.0])
    assert planner.forecast(state).choice == 1
    found = counterfactuals(lambda s: planner.forecast(s).choice, hall, state, ranges)
    by_fluent = {change.fluent: change for change in found.changes}
    assert by_fluent["open"].becomes == 0.0 and by_fluent["open"].outcome == "0"
    x = by_fluent["x"]  # below 0.25 a leap ends in the hole
    assert x.becomes == pytest.approx(0.25) and x.becomes < 0.25 and x.outcome == "0"
    assert x.share == pytest.approx(0.025)
    whole = counterfactuals(lambda s: planner.forecast(s).choice, hall, state, ranges, whole=[1])
    assert [
        change.becomes for change in whole.changes if change.fluent == "x"
    ] == []  # 0 and 1 are none
    one = np.array([1.0, 1.0])
    whole = counterfactuals(lambda s: planner.forecast(s).choice, hall, one, ranges, whole=[1])
    assert [change.becomes for change in whole.changes if change.fluent == "x"] == [0.0]
    assert found.changes[0].share == min(change.share for change in found.changes)
