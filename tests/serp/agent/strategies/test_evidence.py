"""The lead goes to planner or learner as their returns suggest."""

import copy
import json
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.agent.evidence import Evidence
from serp.errors import RunError
from serp.settings import Settings, resolve
from tests.serp.agent.scene import decided, learner_acts, step

RETURNS = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -200.0, 1e300, -1e200, 1e-300])
EPISODES = st.lists(st.tuples(RETURNS, st.integers(1, 500)), max_size=30)


LEARNS = Settings().replace({"learner": {"learning_starts": 0}})
"""The learner learns from the first step on."""


def played(value, seed, episodes, noise=0.0):
    """A strategy after episodes worth `value(learner leads, number)`, and who led each."""
    strategy, rng = Evidence(LEARNS, seed), np.random.default_rng(seed)
    led = []
    for episode in range(episodes):
        led.append(learner_acts(strategy))
        strategy.end_episode(value(led[-1], episode) + noise * rng.standard_normal(), 10)
    return strategy, led


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_better_one_leads_in_the_end_and_is_the_trained_policy(scale):
    for seed in range(10):
        worse, _ = played(lambda leads, _: 0.0 if leads else 10.0 * scale, seed, 60, scale)
        better, _ = played(lambda leads, _: 10.0 * scale if leads else 0.0, seed, 60, scale)
        assert worse.rho < 0.1 and worse.choice.startswith("the planner's choice")
        assert better.rho > 0.9 and better.choice == "the learner's choice"
        assert better.evidence.learner.mean == pytest.approx(10.0 * scale, abs=2.0 * scale)


@pytest.mark.parametrize("learner", [True, False])
def test_a_lead_that_becomes_better_is_found(learner):
    """With a tenth of the episodes 30 lower, which says nothing of who is better."""

    def value(leads, episode):
        better = 0.0 if episode < 60 else 20.0
        return (better if leads is learner else 10.0) - 30.0 * (episode % 10 == 9)

    found = [played(value, seed, 250, 1.0)[0].rho > 0.5 for seed in range(20)]
    assert np.mean([right is learner for right in found]) >= 0.9


@given(EPISODES, st.integers(0, 100))
@settings(max_examples=100, deadline=None)
def test_evidence_of_any_returns_is_finite_and_a_resumed_run_equals_another(episodes, seed):
    strategy, resumed = Evidence(LEARNS, seed), Evidence(LEARNS, seed + 1)
    for value, length in episodes:
        strategy.end_episode(value, length)
        resumed.load_state_dict(json.loads(json.dumps(strategy.state_dict())))
        assert resumed.state_dict() == strategy.state_dict()
        assert resumed.evidence == strategy.evidence and resumed.rho == strategy.rho
        assert 0.0 <= strategy.rho <= 1.0
        evidence = strategy.evidence
        said = evidence.as_dict()
        json.dumps(said, allow_nan=False)
        kept = [v for v, _ in episodes if abs(v) < 1e150]
        for worth in (evidence.planner, evidence.learner):
            if worth is not None:
                span = max(kept) - min(kept)
                slack = 1e-6 * max(map(abs, kept))
                assert min(kept) - slack <= worth.mean <= max(kept) + slack
                assert 0.0 <= worth.deviation <= span
                assert str(worth) in said["sentence"]


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=20), st.floats(0.01, 1e4))
def test_the_unit_and_the_zero_of_the_reward_do_not_matter(values, scale):
    plain, scaled = Evidence(LEARNS, 1), Evidence(LEARNS, 1)
    for value in np.round(values, 3):
        plain.end_episode(float(value), 5)
        scaled.end_episode(float(value) * scale + 7.0 * scale, 5)
    assert scaled.rho == pytest.approx(plain.rho, abs=1e-5)


def forged():
    return st.sampled_from([None, -1, 0.5, 1e308, -1e308, math.nan, 2**70, "x", [], {}, [1.0, 0.0]])


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_a_forged_state_is_refused_or_gone_on_with(data):
    strategy, _ = played(lambda leads, episode: float(episode % 7), 3, 20)
    meta = copy.deepcopy(strategy.state_dict())
    name = data.draw(st.sampled_from(sorted(meta)))
    if name in ("planner", "learner"):
        part = meta[name]
        part[data.draw(st.sampled_from(sorted(part)))] = data.draw(forged())
    else:
        meta[name] = data.draw(forged())
    other = Evidence(LEARNS, 0)
    try:
        other.load_state_dict(meta)
    except RunError:
        return
    for _ in range(3):
        assert 0.0 <= other.rho <= 1.0
        json.dumps(other.evidence.as_dict(), allow_nan=False)
        other.end_episode(1.0, 10)


@pytest.mark.parametrize("seed", range(3))
def test_the_learner_imitates_the_planner_as_long_as_that_is_better(seed):
    strategy, rng = Evidence(LEARNS, seed), np.random.default_rng(seed)
    assert strategy.imitation_weight == 1.0  # nothing is known of the learner
    for episode in range(200):
        learner = 0.0 if episode < 60 else 20.0
        strategy.end_episode((learner if learner_acts(strategy) else 10.0) + rng.normal(), 10)
        assert strategy.imitation_weight == 1.0 - strategy.rho
        said = strategy.lesson(step(decided([0.0, 1.0], 0)), None).imitated
        assert said == (-1 if learner_acts(strategy) else 1)  # only what it demonstrates
        alike = strategy.lesson(step(decided([1.0, 1.0], 0)), None)
        assert alike.imitated == -1  # a choice without a reason
    assert strategy.imitation_weight < 0.1


def test_a_learner_that_has_learned_nothing_yet_never_leads():
    strategy = Evidence(Settings().replace({"learner": {"learning_starts": 90}}), 0)
    rng = np.random.default_rng(0)
    for _ in range(9):
        assert strategy.rho == 0.0 and not learner_acts(strategy)
        strategy.end_episode(rng.normal(), 10)
    strategy.end_episode(rng.normal(), 10)
    assert strategy.rho > 0.0


@pytest.mark.parametrize("value", [0.0, -200.0, 0.1, 1e12])
def test_where_all_returns_are_equal_the_learner_is_tried_ever_more_seldom(value):
    after = [played(lambda leads, _: value, 1, n)[0].rho for n in range(30)]
    assert after[0] == 0.0 and after[1] <= 1 / 6
    assert all(later < earlier for earlier, later in pairwise(after[1:]))
    led = [sum(played(lambda leads, _: value, seed, 100)[1]) for seed in range(20)]
    assert 0 < np.mean(led) < 5


@pytest.mark.parametrize(("name", "value"), [("count", 1e9), ("mean", 1e6)])
def test_returns_that_do_not_fit_together_are_refused(name, value):
    strategy = Evidence(resolve("default"))
    for k in range(5):
        strategy.end_episode(float(k), 10)
    saved = strategy.state_dict()
    saved["planner"][name] = value
    with pytest.raises(RunError, match="do not match their count and range"):
        strategy.load_state_dict(saved)
