from __future__ import annotations

import numpy as np

from serp.comparison.analysis.results import Results
from serp.comparison.analysis.variants import planner_returns, pooled_final, variant_rows
from tests.serp.comparison.made_up import metadata, trial

SEEDS = range(5)


def made(good=90.0, bad=88.0, plain=60.0, planners=(50.0, 10.0), spread=2.0):
    """Two domain files, the second with a bad planner, and plain DQN on the first alone."""
    found = []
    for seed in SEEDS:
        found.append(trial("serp", seed, good, spread=spread))
        found.append(trial("serp", seed, bad, variant="wrong", spread=spread))
        found.append(trial("dqn", seed, plain, spread=spread))
        for variant, level in zip(("base", "wrong"), planners, strict=True):
            found.append(trial("mrp", seed, level, variant=variant, planner=level, spread=spread))
    return Results(found, metadata(found))


def test_a_row_for_each_domain_file_the_base_first():
    base, wrong = variant_rows(made())
    assert (base.variant, wrong.variant) == ("base", "wrong")
    assert base.seeds == wrong.seeds == len(SEEDS)
    assert base.planner.value > 45 and wrong.planner.value < 15
    assert base.final.value > 80


def test_no_regret_holds_where_the_final_learner_is_as_good_as_plain_dqn():
    for row in variant_rows(made()):
        assert row.final_check.verdict == row.early_check.verdict == "holds"
        assert row.final_check.to == "dqn"
    assert pooled_final(made()).verdict == "holds"


def test_no_regret_fails_where_a_wrong_model_spoils_the_learner():
    base, wrong = variant_rows(made(bad=20.0))
    assert base.final_check.verdict == "holds"
    assert wrong.final_check.verdict == wrong.early_check.verdict == "does not hold"
    assert wrong.final_check.difference.high < wrong.final_check.limit


def test_no_regret_is_undecided_where_the_limit_lies_inside_the_interval():
    results = made(bad=45.0, spread=15.0)
    check = variant_rows(results)[1].final_check
    assert check.difference.low < check.limit < check.difference.high
    assert check.verdict == "undecided"


def test_early_returns_are_held_against_the_better_of_planner_and_plain_dqn():
    base, wrong = variant_rows(made(planners=(80.0, 10.0)))
    assert (base.early_check.to, wrong.early_check.to) == ("mrp", "dqn")


def test_one_seed_measures_nothing():
    results = made()
    few = [record for record in results.records if record.trial.seed == 0]
    for row in variant_rows(Results(few, metadata(few))):
        assert row.final_check.verdict == row.early_check.verdict == "not measured"


def test_without_the_planner_alone_its_worth_is_unknown():
    results = made()
    few = [record for record in results.records if record.trial.algorithm != "mrp"]
    without = Results(few, metadata(few))
    assert len(planner_returns(without, "base")) == 0
    assert all(np.isnan(row.planner.value) for row in variant_rows(without))
