from __future__ import annotations

import numpy as np

from serp.runs.comparison.statistics import (
    GRID,
    checkpoints,
    evaluation_curves,
    running_return,
    training_curves,
)
from tests.serp.runs.comparison.made_up import record


def test_the_running_return_is_the_mean_up_to_the_episode_at_a_step():
    one = record([5.0, 7.0, 9.0], [10, 20, 5])
    at = np.array([0, 1, 10, 11, 30, 31, 35, 100], float)
    assert running_return(one, at).tolist() == [5, 5, 5, 6, 6, 7, 7, 7]


def test_training_curves_go_from_the_first_step_to_the_budget():
    curves = training_curves([record([4.0] * 9), record([6.0] * 3), record([])], 200)
    assert (curves.x[0], curves.x[-1], len(curves.x)) == (0, 200, GRID)
    assert curves.y.shape == (2, GRID)
    assert (curves.y[0] == 4).all() and (curves.y[1] == 6).all()


def test_evaluations_share_a_grid_with_straight_lines_in_between():
    one = record(
        [1.0], evaluations=[(10, "learner", 0.0), (10, "learner", 2.0), (30, "learner", 5)]
    )
    other = record([1.0], evaluations=[(20, "learner", 7.0), (30, "vetoed", 99.0)])
    assert checkpoints(one).returns.tolist() == [1.0, 5.0]
    curves = evaluation_curves([one, other, record([1.0])])
    assert curves.x.tolist() == [10, 20, 30]
    assert curves.y.tolist() == [[1, 3, 5], [7, 7, 7]]


def test_no_data_give_empty_curves():
    for curves in (
        evaluation_curves([record([1.0])]),
        training_curves([], 10),
    ):
        assert curves.y.shape[0] == 0
