from __future__ import annotations

import numpy as np

from serp.runs.comparison.measures import Results, planner_returns, variant_rows
from tests.serp.runs.comparison.made_up import metadata, trial

SEEDS = range(5)


def made(good=90.0, bad=88.0, plain=60.0, planners=(50.0, 10.0), without=()):
    """Two domain files, the second with a bad planner, and plain DQN on the first alone."""
    found = []
    for seed in SEEDS:
        found.append(trial("serp", seed, good, spread=2.0))
        found.append(trial("serp", seed, bad, variant="wrong", spread=2.0))
        found.append(trial("dqn", seed, plain, spread=2.0))
        for variant, level in zip(("base", "wrong"), planners, strict=True):
            found.append(trial("mrp", seed, level, variant=variant, planner=level, spread=2.0))
    found = [record for record in found if record.trial.algorithm not in without]
    return Results(found, metadata(found))


def test_a_row_for_each_domain_file_the_base_first():
    base, wrong = variant_rows(made(bad=20.0))
    assert (base.variant, wrong.variant) == ("base", "wrong")
    assert base.seeds == wrong.seeds == len(SEEDS)
    assert base.planner.value > 45 and wrong.planner.value < 15
    assert base.final.value > 80
    assert base.final_difference.low > 0 > wrong.final_difference.high
    assert base.early_difference.low > 0 > wrong.early_difference.high


def test_early_returns_are_held_against_the_better_of_planner_and_plain_dqn():
    base, wrong = variant_rows(made(planners=(80.0, 10.0)))
    assert (base.better, wrong.better) == ("mrp", "dqn")


def test_without_the_planner_alone_its_worth_is_unknown():
    without = made(without=("mrp",))
    assert len(planner_returns(without, "base")) == 0
    assert all(np.isnan(row.planner.value) for row in variant_rows(without))
