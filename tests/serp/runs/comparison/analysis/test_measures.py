from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.runs.comparison.measures import BY_NAME, MEASURES, extra_measures, measure
from tests.serp.runs.comparison.made_up import record

BUDGET = 100


@given(st.lists(st.tuples(st.floats(-99, 99), st.integers(1, 40)), min_size=1, max_size=12))
def test_the_training_area_is_the_mean_over_all_steps_of_the_return_of_the_running_episode(rows):
    returns, lengths = zip(*rows, strict=True)
    one = record(returns, lengths)
    running = np.append(np.repeat(returns, lengths), np.full(BUDGET, returns[-1]))[:BUDGET]
    area = measure(one, BUDGET, None)["training_area"]
    assert area == pytest.approx(running.mean(), abs=1e-9)


def test_the_learners_area_is_under_straight_lines_between_checkpoints():
    one = record([0.0], evaluations=[(25, "learner", 4.0), (75, "learner", 8.0)])
    # 25 steps at 4, 50 rising to 8, 25 at 8
    assert measure(one, BUDGET, None)["learner_area"] == pytest.approx(
        0.25 * 4 + 0.5 * 6 + 0.25 * 8
    )


def test_first_and_last_episodes():
    found = measure(record(list(range(60))), 600, None)
    assert found["first_10"] == 4.5
    assert found["first_50"] == 24.5
    assert found["last_20"] == 49.5
    assert measure(record([1.0, 3.0]), 20, None)["first_50"] == 2


@given(st.lists(st.floats(0, 9.9), max_size=60), st.integers(1, 40))
def test_a_threshold_that_is_never_reached_is_never_or_too_few_episodes_tell(returns, evaluated):
    found = measure(record(returns, evaluations=[(10, "learner", 5.0)] * evaluated), BUDGET, 10.0)
    trained = [found["threshold_env_steps"], found["threshold_episodes"]]
    assert np.isnan(trained).all() if len(returns) < 20 else np.isinf(trained).all()
    alone = found["learner_threshold_env_steps"]
    assert np.isnan(alone) if evaluated < 20 else np.isinf(alone)
    assert np.isnan(found["learner_threshold_held"])


def test_times_to_the_threshold():
    levels = [(10, 1.0), (20, 9.0), (30, 2.0), (40, 9.0)]
    one = record(
        [0.0] * 30 + [10.0] * 30,
        evaluations=[(at, "learner", level) for at, level in levels for _ in range(5)],
    )
    found = measure(one, 600, 5.0)
    assert found["threshold_episodes"] == 40  # the first 20 in a row with a mean of 5: 21 to 40
    assert found["threshold_env_steps"] == 400
    assert found["learner_threshold_env_steps"] == 20
    assert found["learner_threshold_held"] == 0.5


def test_one_good_episode_is_no_good_policy():
    found = measure(record([99.0] * 19, evaluations=[(10, "learner", 99.0)] * 19), 600, 5.0)
    assert np.isnan([value for name, value in found.items() if "threshold" in name]).all()
    assert measure(record([99.0] * 20), 600, 5.0)["threshold_episodes"] == 20


def test_final_values_come_from_the_last_evaluation_of_each_policy():
    one = record(
        [1.0],
        evaluations=[(10, "learner", 1.0), (20, "learner", 5.0), (20, "learner", 7.0),
                     (20, "planner", 3.0)],
    )  # fmt: skip
    found = measure(one, BUDGET, None)
    assert (found["final_learner"], found["planner"]) == (6.0, 3.0)
    assert np.isnan(found["final_vetoed"])


def test_the_lead_is_that_of_the_strategy_where_it_is_known():
    worth = {"mean": 7.0, "deviation": 1.0, "episodes": 3}
    for evidence, expected in (
        ({"planner": worth, "learner": None}, [0.25, 7.0, np.nan]),
        (None, [0.25, np.nan, np.nan]),
    ):
        one = record([1.0], metadata={"lead": {"rho": 0.25, "evidence": evidence}})
        found = measure(one, BUDGET, None)
        names = ("rho", "planner_led", "learner_led")
        np.testing.assert_equal([found[name] for name in names], expected)


def test_counts_outcomes_counters_and_seconds():
    one = record(
        [1.0, 2.0, 3.0],
        outcomes=["goal", "", "goal"],
        info={"hits": [1, 0, 2]},
        unsafe=4,
        metadata={"seconds": {"training": 1.5, "evaluation": 9.0}},
    )
    found = measure(one, BUDGET, None)
    assert found["outcome.goal"] == 2 and "outcome." not in found
    assert found["info.hits"] == 3
    assert (found["unsafe"], found["avoidable_unsafe"], found["terminated"]) == (4, 4, 3)
    assert found["planner_share"] == 0.5
    assert (found["seconds"], found["seconds_per_1000"]) == (1.5, 50.0)


def test_a_trial_without_a_complete_episode_or_a_threshold_has_holes_and_no_failure():
    found = measure(record([]), BUDGET, 5.0)
    assert found["episodes"] == 0
    assert np.isnan([found["training_area"], found["threshold_env_steps"]]).all()
    without = measure(record([9.0] * 30), BUDGET, None)
    assert np.isnan([without["threshold_env_steps"], without["learner_threshold_env_steps"]]).all()


def test_every_measure_is_taken_and_described():
    found = measure(record([1.0], outcomes=["goal"], info={"hits": [1]}), BUDGET, 1.0)
    described = [*MEASURES, *extra_measures([*found, "info.outcome.x"] * 2)]
    assert [each.name for each in described] == [
        *BY_NAME, "info.hits", "info.outcome.x", "outcome.goal"
    ]  # fmt: skip
    assert set(found) | {"info.outcome.x"} == {each.name for each in described}
    assert [each.title for each in described[-3:]] == ["hits", "outcome.x", "outcome goal"]
    assert all(each.meaning.endswith(".") and each.meaning[0].isupper() for each in described)
