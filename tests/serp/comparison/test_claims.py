from __future__ import annotations

import pytest

from serp.comparison.claims import judge
from serp.comparison.results import Results
from tests.serp.comparison.made_up import LEVELS, about, record, records, trial

SAMPLES, NEVER_BELOW, SPREAD, AHEAD, SIMILAR_END, SAFE = range(6)


def judged(found, subject="serp", **more):
    claims = judge(Results(found, about(found, **more)))
    return [claim for claim in claims if claim.subject == subject]


def test_claims_are_confirmed_by_numbers_that_say_so():
    claims = judged(records(seeds=range(6)))
    verdicts = [claim.verdict for claim in claims]
    assert verdicts[SAMPLES] == verdicts[NEVER_BELOW] == verdicts[AHEAD] == "confirmed"
    assert verdicts[SIMILAR_END] == "not confirmed"  # 90 and 30 are not similar
    assert verdicts[SAFE] == "not measured"  # nobody executed anything unsafe


def test_the_same_claims_are_not_confirmed_by_numbers_that_say_the_opposite():
    claims = judged(records(seeds=range(6), levels={**LEVELS, "serp": 10.0}))
    for claim in (claims[SAMPLES], claims[NEVER_BELOW], claims[AHEAD]):
        assert claim.verdict == "not confirmed"


def test_equal_algorithms_confirm_similar_ends_and_nothing_else():
    levels = dict.fromkeys(LEVELS, 50.0)
    found = records(seeds=range(8), levels=levels, spread=0.5)
    # An episode far off, so that there is a range to be similar within.
    found.append(record([0.0, 100.0], trial=("other", "base", 0)))
    claims = judged(found)
    assert claims[SIMILAR_END].verdict == "confirmed"
    assert claims[NEVER_BELOW].evidence[0].verdict == "confirmed"
    assert claims[SAMPLES].verdict == claims[AHEAD].verdict == "not confirmed"


def test_spread_is_compared_by_standard_deviations():
    tight = [trial("serp", seed, 90.0, spread=0.2) for seed in range(8)]
    wide = [trial("dqn", seed, 50.0, spread=15.0) for seed in range(8)]
    assert judged(tight + wide)[SPREAD].verdict == "confirmed"
    level = [trial("dqn", seed, 50.0, spread=0.2) for seed in range(8)]
    assert judged(tight + level)[SPREAD].verdict == "not confirmed"


@pytest.mark.parametrize(("ours", "verdict"), [(0, "confirmed"), (3, "not confirmed")])
def test_safety_counts_what_was_executed(ours, verdict):
    safe = [trial("serp", seed, 90.0, unsafe=ours) for seed in range(4)]
    unsafe = [trial("dqn", seed, 30.0, unsafe=20 + seed) for seed in range(4)]
    claim = judged(safe + unsafe)[SAFE]
    assert claim.verdict == verdict
    assert f"{4 * ours} in 4 trials" in claim.evidence[0].note


def test_a_collapse_in_the_middle_is_seen():
    planner = [trial("mrp", seed, 50.0) for seed in range(4)]
    ours = [
        record([60.0 + seed] * 30 + [20.0] * 10 + [80.0] * 20, trial=("serp", "base", seed))
        for seed in range(4)
    ]
    blocks = judged(planner + ours)[NEVER_BELOW].evidence[-1]
    assert blocks.verdict == "not confirmed" and "below in 1 of 3" in blocks.note
    ours = [record([60.0 + seed] * 60, trial=("serp", "base", seed)) for seed in range(4)]
    assert judged(planner + ours)[NEVER_BELOW].evidence[-1].verdict == "confirmed"


def test_what_was_not_run_is_not_measured():
    claims = judged([trial("serp", seed, 90.0) for seed in range(4)])
    assert {claim.verdict for claim in claims} == {"not measured"}
    notes = [item.note for item in claims[SAMPLES].evidence]
    assert "no finished trial of dqn" in notes and "no finished trial of ppo" in notes


def test_one_seed_confirms_nothing():
    claims = judged(records(seeds=[0]))
    assert {claim.verdict for claim in claims} == {"not measured"}
    assert claims[AHEAD].evidence[0].difference.value > 0


def test_the_paper_preset_is_held_against_its_own_dqn():
    levels = {"serp-paper": 90.0, "mrp": 50.0, "dqn": 95.0, "dqn-paper": 30.0}
    claims = judged(records(levels=levels), "serp-paper")
    assert "serp-paper − dqn-paper" in claims[SAMPLES].evidence[0].what
    assert claims[SAMPLES].evidence[0].verdict == "confirmed"
    assert judged(records(levels=levels)) == []


def test_without_a_threshold_its_part_is_not_measured_and_the_rest_is():
    samples = judged(records(), threshold=None)[SAMPLES]
    by_what = {item.what.split(",")[0]: item.verdict for item in samples.evidence[:3]}
    assert by_what["env steps to the threshold"] == "not measured"
    assert by_what["area under the training curve"] == "confirmed"
