"""The guides: each by the property that defines it, and that a resumed one goes on the same."""

import json

import numpy as np
import pytest

from serp._util.plugins import offered
from serp.agent.decision import Actor
from serp.agent.registry import STRATEGIES, find_strategy
from serp.agent.strategy import Situation
from serp.errors import RunError
from serp.settings import resolve
from serp_adapters.guides.ac_teach import LEARNER
from serp_adapters.guides.jump_start import STAGES
from serp_adapters.guides.r_max import KNOWN
from tests.serp.agent.scene import Known, decided, forecast, learner_acts, situation, step

GUIDES = sorted(set(offered(STRATEGIES)) - {"evidence", "learner", "mixture"})


def made(name, seed=0, **learner):
    changes = {"guide": {"strategy": name}, "learner": {"epsilon_steps": 40, **learner}}
    return find_strategy(name)(resolve("default", None, changes), seed)


def test_darling_never_leaves_the_actions_of_reasonable_plans():
    strategy, rng = made("darling"), np.random.default_rng(0)
    for _ in range(200):
        values, q = rng.normal(size=5), rng.normal(size=5)
        best = values.max()
        for proposal in (
            strategy.propose(situation(values), Known(q)),
            strategy.propose_greedily(situation(values), Known(q)),
        ):
            assert values[proposal.action] >= best - 0.5 * abs(best)
        lesson = strategy.lesson(step(decided(values, 0)), decided(values, 0))
        assert (lesson.allowed == (values >= best - 0.5 * abs(best))).all()


def test_loki_switches_from_imitation_to_rewards_alone_within_the_second_half():
    for seed in range(20):
        strategy, switched = made("loki", seed), None
        for k in range(60):
            if strategy.imitation_weight == 0.0 and switched is None:
                switched = k
            imitated = strategy.lesson(step(decided([0.0, 1.0], 0)), None).imitated
            assert imitated == (1 if switched is None else -1)
            learner_acts(strategy)
        assert 20 <= switched == strategy.imitation_steps <= 40 and strategy.rho == 1.0


def test_demonstrations_end_and_their_margin_stays():
    strategy = made("dqfd")
    shown = [not learner_acts(strategy) for _ in range(60)]
    assert shown == [True] * 40 + [False] * 20
    by_planner = step(decided([0.0, 1.0], 1, Actor.PLANNER))
    assert strategy.lesson(by_planner, None).imitated == 1 and strategy.imitation_weight == 1.0
    assert strategy.lesson(step(decided([0.0, 1.0], 1)), None).imitated == -1


def test_the_planners_part_of_an_episode_shrinks_while_returns_hold_and_stays_where_they_fall():
    strategy, shares = made("jsrl"), []
    for episode in range(5 * (STAGES + 2)):
        acts = [learner_acts(strategy) for _ in range(10)]
        assert acts == sorted(acts)  # the planner first
        shares.append(sum(acts))
        strategy.end_episode(1.0 if episode != 7 else -50.0, 10)
    assert shares[0] == 0 and shares[-1] == 10
    assert shares == sorted(shares) and shares[14] == shares[5] + 1  # one mean had fallen


def test_the_policy_acts_whose_action_the_critic_values_most_and_it_keeps_on():
    strategy = made("ac-teach")
    scene = situation([1.0, 0.0, 0.0])  # the planner says 0, the learner what it values most
    assert strategy.propose(scene, Known([2.0, 1.0, 0.0])) is None  # 0 is the planner's, too
    mixed = Known([0.0, 1.0, 0.0])
    mixed.values = lambda: np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert all(strategy.propose(scene, mixed) is None for _ in range(20))  # not sure enough
    assert strategy.propose(scene, Known([0.0, 1.0, 0.0])).action == 1
    assert strategy._acting[0] == LEARNER


def test_a_residual_of_zero_is_the_planners_policy_and_what_is_taught_is_what_it_lacks():
    strategy, rng = made("residual"), np.random.default_rng(0)
    gamma = strategy._settings.planner.discount
    for _ in range(50):
        values = rng.normal(size=4)
        greedy = strategy.propose_greedily(situation(values), Known(np.zeros(4)))
        assert greedy.action == values.argmax()
        # Where the plan comes true, nothing is missing.
        now, then = decided(values, 1), decided(rng.normal(size=4), 2)
        reward = values[1] - gamma * then.forecast.value[2]
        lesson = strategy.lesson(step(now, reward), then)
        assert lesson.reward == pytest.approx(0.0) and lesson.allowed.tolist() == [0, 0, 1, 0]
        assert strategy.lesson(step(now, values[1], terminated=True), None).reward == 0.0


def test_unknown_actions_are_worth_the_most():
    """In a corridor whose far end is unknown, R-Max walks there past a reward that it knows."""
    strategy = made("r-max")

    def scene(state):
        return Situation(np.array([float(state)]), forecast([1.0, 0.0]), np.ones(2, bool))

    ends = []
    for _ in range(60):
        state = 1
        for _ in range(20):
            proposal = strategy.propose(scene(state), Known([0.0, 0.0]))
            action = 0 if proposal is None else proposal.action  # 0: left, 1: right
            after, reward = (0, 1.0) if state == 1 and action == 0 else (state + 2 * action - 1, 0)
            reward = 3.0 if after == 5 else reward
            over = after in (0, 5)
            strategy.lesson(step(decided([1.0, 0.0], action), reward, state, after, over), None)
            state = after
            if over:
                break
        ends.append(state)
    assert ends[:KNOWN] == [0] * KNOWN and ends[-10:] == [5] * 10
    assert strategy.propose_greedily(scene(1), Known([0.0, 0.0])).action == 1


def test_a_plan_is_carried_out_before_the_learner_chooses_again():
    strategy = made("tmp-rl")
    strategy._settings = strategy._settings.replace({"planner": {"depth": 3}})
    scene = situation([1.0, 0.9, -5.0])
    scene.known = scene.known._replace(depth=8)
    asked = [strategy.propose(scene, Known([0.0, 1.0, 2.0])) for _ in range(7)]
    assert [k for k, each in enumerate(asked) if each is not None] == [0, 3, 6]
    assert {each.action for each in asked if each} == {1}  # 2 begins no good plan


@pytest.mark.parametrize("name", GUIDES)
def test_a_restored_guide_goes_on_the_same_and_a_damaged_one_is_refused(name):
    strategy, resumed, rng = made(name, 1), made(name, 2), np.random.default_rng(0)

    def episode(guide, random):
        made = []
        for _ in range(6):
            values, q = random.normal(size=3), random.normal(size=3)
            proposal = guide.propose(situation(values), Known(q))
            action = int(values.argmax()) if proposal is None else proposal.action
            decision = decided(values, action)
            made.append((proposal, guide.rho, guide.imitation_weight))
            made.append(guide.lesson(step(decision, 1.0, action, action + 1), decision)[:2])
        guide.end_episode(float(random.normal()), 6)
        return made

    for _ in range(20):
        episode(strategy, rng)
    saved = json.loads(json.dumps(strategy.state_dict(), allow_nan=False))
    resumed.load_state_dict(saved)
    assert resumed.state_dict() == strategy.state_dict()
    for seed in range(8):
        rngs = np.random.default_rng(seed), np.random.default_rng(seed)
        assert episode(strategy, rngs[0]) == episode(resumed, rngs[1])
    for key in saved:
        with pytest.raises(RunError):
            made(name).load_state_dict({**saved, key: "damaged"})


def test_a_jump_start_whose_returns_fall_is_restored():
    strategy, resumed = made("jsrl"), made("jsrl")
    for k in range(12):
        strategy.end_episode(-float(k), 10)
    resumed.load_state_dict(json.loads(json.dumps(strategy.state_dict())))
    assert resumed.state_dict() == strategy.state_dict()
