"""Measures of trials by hand, and their statistics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.runs.comparison.statistics import (
    MEASURES,
    Results,
    estimate,
    evaluation_curves,
    measure,
    training_curves,
)
from tests.serp.runs.comparison.made_up import plan_of, record, records

BUDGET = 100
samples = st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=1, max_size=12)


@given(st.lists(st.tuples(st.floats(-99, 99), st.integers(1, 8)), min_size=1, max_size=12))
def test_the_training_area_is_the_mean_over_all_steps_of_the_return_of_the_running_episode(rows):
    returns, lengths = zip(*rows, strict=True)
    running = np.append(np.repeat(returns, lengths), np.full(BUDGET, returns[-1]))[:BUDGET]
    area = measure(record(returns, lengths), BUDGET, None)["training_area"]
    assert area == pytest.approx(running.mean(), abs=1e-9)


def test_the_measures_of_a_trial():
    one = record(
        list(range(60)), unsafe=4, outcomes=["goal", "", "goal", "pit"], slips=[1, 0, 2, 1],
        evaluations=[(150, "learner", 4.0), (450, "learner", 8.0), (600, "learner", 8.0),
                     (600, "policy", 6.0), (600, "policy", 10.0)],
    )  # fmt: skip
    values = measure(one, 600, 39.5)
    expected = {
        "first_50": 24.5, "last_20": 49.5, "unsafe": 4, "avoidable_unsafe": 4, "terminated": 60,
        "planner_share": 0.5, "seconds_per_1000": 1.0, "final_learner": 8.0, "final_policy": 8.0,
        "threshold_env_steps": 500,  # the first 20 in a row with a mean of 39.5: 31 to 50
        "learner_area": 0.25 * 4 + 0.5 * 6 + 0.25 * 8,
    }  # fmt: skip
    assert {name: values[name] for name in expected} == pytest.approx(expected)
    assert (values["outcome.pit"], values["info.slips"]) == (0.5, 1.5)
    assert [m.name for m in MEASURES] == [name for name in values if "." not in name]
    assert measure(one, 600, 99.0)["threshold_env_steps"] == np.inf


@settings(max_examples=60, deadline=None)
@given(samples, st.randoms())
def test_an_interval_holds_its_estimate_and_ignores_the_order_of_seeds(values, random):
    value, low, high = found = estimate(values)
    if low is not None and high is not None:
        assert min(values) - 1e-6 <= low <= value <= high <= max(values) + 1e-6
    assert (low is None) == (len(values) < 2)
    assert estimate(random.sample(values, len(values))) == found


@settings(max_examples=40, deadline=None)
@given(samples, samples)
def test_a_difference_turns_its_sign_with_its_sides(first, second):
    one = estimate(first, second)
    assert one.value == -estimate(second, first).value
    assert (one.low is None) == (min(len(first), len(second)) < 2)


def test_degenerate_samples_have_a_defined_answer():
    assert np.isnan(estimate([]).value) and estimate([])[1:] == (None, None)
    assert estimate([7.0]) == (7.0, None, None)
    assert estimate([7.0] * 5) == (7.0, 7.0, 7.0)
    assert estimate([1.0, 2.0], [5.0]) == (-3.5, None, None)
    assert np.isnan(estimate([1.0, 2.0], []).value)


def test_curves_are_those_of_the_trials():
    one = record([0.0, 10.0], [20, 30], evaluations=[(50, "learner", 4.0), (100, "learner", 8.0)])
    training = training_curves([one, record([])], BUDGET)
    assert training.y.shape == (1, len(training.x))  # nothing is known of the second one
    assert training.y[0, 0] == 0 and training.y[0, -1] == 5  # the mean of both
    evaluated = evaluation_curves([one])
    assert (evaluated.x.tolist(), evaluated.y.tolist()) == ([50, 100], [[4, 8]])
    assert evaluation_curves([record([])]).y.size == 0


def test_results_are_in_the_order_of_the_plan_and_few_seeds_are_said():
    found = records(range(4))
    results = Results(reversed(found), plan_of(found))
    assert [r.trial for r in results.records] == [r.trial for r in found]
    assert results.algorithms == ["serp", "mrp", "dqn"]
    assert results.caution is not None and "Few seeds (4)" in results.caution
    assert Results(records(range(5)), plan_of(records(range(5)))).caution is None
    assert results.estimate("last_20", "serp", "dqn").value == pytest.approx(60, abs=10)
    # A threshold that is never reached counts as the whole budget.
    assert results.known("dqn", "threshold_env_steps").tolist() == [600] * 4
