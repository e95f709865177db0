from __future__ import annotations

import numpy as np
import pytest

from serp.runs.comparison.measures import Results
from tests.serp.runs.comparison.made_up import metadata, record, records, trial


def test_trials_come_in_the_order_asked_for_whatever_their_order():
    found = [*records(seeds=(3, 1)), trial("serp", 1, 10.0, variant="a-variant")]
    asked = metadata(found, algorithms={name: {} for name in ("dqn", "serp", "mrp")})
    one, other = Results(found, asked), Results(found[::-1], asked)
    assert [r.trial for r in one.records] == [r.trial for r in other.records]
    assert one.algorithms == ("dqn", "serp", "mrp")
    assert [r.trial.seed for r in one.of("serp")] == [1, 3]
    assert one.on("a-variant") == ("serp",)
    assert one.estimate("serp", "training_area") == other.estimate("serp", "training_area")


def test_missing_trials_are_named():
    found = records(seeds=(0, 1))
    asked = metadata(found)
    assert Results(found, asked).missing == ()
    assert Results(found[1:], asked).missing == (found[0].trial,)
    assert Results([], asked).algorithms == ()


def test_never_counts_as_the_whole_training_in_intervals_only():
    found = [
        record([0.0] * 25, trial=("dqn", "base", 0)),
        record([99.0] * 25, trial=("dqn", "base", 1)),
    ]
    results = Results(found, metadata(found))
    assert results.values("dqn", "threshold_env_steps").tolist() == [np.inf, 200]
    assert results.known("dqn", "threshold_env_steps").tolist() == [600, 200]
    assert results.known("dqn", "threshold_episodes").tolist() == [25, 20]
    assert results.known("dqn", "final_learner").tolist() == []


def test_few_seeds_are_named_and_enough_are_not():
    found = [trial("serp", s, 90.0) for s in range(5)] + [trial("dqn", s, 30.0) for s in range(3)]
    assert "Few seeds (3):" in Results(found, metadata(found)).caution
    found += [trial("dqn", s, 30.0) for s in (3, 4)]
    assert Results(found, metadata(found)).caution is None
    found += [trial("serp", s, 9.0, variant=name) for name, s in (("a", 0), ("b", 0), ("b", 1))]
    assert "Few seeds (1 to 2):" in Results(found, metadata(found)).caution
    assert Results([], metadata(found)).caution is None


def test_an_outcome_that_never_came_counts_nothing():
    found = [
        record([1.0], outcomes=["goal"]),
        record([1.0], outcomes=["exit"], trial=("serp", "base", 1)),
    ]
    results = Results(found, metadata(found))
    assert results.values("serp", "outcome.goal").tolist() == [1, 0]


def test_the_range_is_of_all_episodes():
    found = [
        record([-3.0, 4.0]),
        record([1.0], trial=("x", "other", 0), evaluations=[(1, "learner", 9.0)]),
    ]
    assert Results(found, metadata(found)).range == 12
    assert Results([], metadata(found)).range == 0


def test_differences_are_first_less_second():
    found = records()
    results = Results(found, metadata(found))
    one = results.difference("serp", "dqn", "final_learner")
    assert one.value == pytest.approx(60, abs=10)
    assert one.low > 0
