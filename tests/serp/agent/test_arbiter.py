"""Who acts, what is refused and what a decision says of itself; `test_guarantee` has the rest."""

import math
from collections import Counter
from random import Random
from typing import NamedTuple

import numpy as np
import pytest

from serp.agent.arbiter import Arbiter
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.strategy import Mixture
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.planning.forecast import SAFE
from serp.planning.lookahead import Lookahead
from serp.settings import ArbiterSettings, PlannerSettings, Settings
from serp.tasks.action_map import ActionMap
from tests.serp.agent.decisions import MODELS, View, Wild, action_maps, arbiter_of, proposer_of
from tests.serp.agent.scene import Known
from tests.serp.planning.worlds import load, states_of
from tests.worlds import text


class Case(NamedTuple):
    """A decision by Algorithm 1, and what the model predicts where it was made."""

    arbiter: Arbiter
    view: View
    state: Vector
    decision: Decision


@pytest.fixture(scope="module")
def cases():
    """Decisions in all worlds, with all maps of actions and settings of all kinds."""
    made = []
    for seed, model in enumerate(MODELS):
        random = Random(seed)
        for number, actions in enumerate([*action_maps(model, random)] * 4):
            arbiter, learner = arbiter_of(actions, random), Wild(100 * seed + number, actions.size)
            for state in states_of(model, random, 9):
                with np.errstate(over="ignore", invalid="ignore"):
                    decision = arbiter.decide(state, proposer_of(learner))
                view = View.of(arbiter, state)
                made.append(Case(arbiter, view, state, decision))
    return made


def test_the_record_tells_what_happened(cases):
    for arbiter, view, _, decision in cases:
        settings = arbiter.settings
        assert decision.rho == arbiter.strategy.rho == settings.rho
        assert decision.admissible.tolist() == view.admissible(settings)
        if view.applicable[decision.action]:
            assert decision.predicted_reward == view.reward[decision.action]
        else:
            assert math.isnan(decision.predicted_reward)
        proposed = "none" if decision.proposed < 0 else view.kind[decision.proposed]
        assert decision.proposal_unsafe == (proposed in ("unsafe", "risky", "certain"))
        assert decision.vetoed == (
            decision.proposed_by is not Actor.PLANNER and decision.reason is not Reason.ACCEPTED
        )
        if decision.proposed_by is Actor.PLANNER:
            assert settings.rho < 1.0
            if decision.reason is Reason.PLANNER_TURN:
                assert decision.action == decision.proposed
        elif decision.reason is Reason.ACCEPTED:
            assert decision.executed_by is decision.proposed_by
            assert decision.action == decision.proposed
            assert decision.admissible[decision.action]
        else:
            assert not decision.admissible[decision.proposed]
            assert decision.executed_by in (Actor.PLANNER, Actor.FALLBACK)
        if decision.executed_by is Actor.PLANNER:
            assert view.applicable[decision.action]


REFUSED = {
    Reason.NOT_APPLICABLE: {"not applicable"},
    Reason.UNDEFINED: {"undefined"},
    Reason.UNSAFE: {"unsafe"},
    Reason.TOO_RISKY: {"risky", "certain"},
    Reason.LOW_REWARD: {"safe"},
    Reason.UNSAFE_AHEAD: {"safe"},
    Reason.UNMODELLED: {"unknown"},
}
"""Reason → kinds of proposals that are refused for it."""


def test_the_reason_is_one_that_holds(cases):
    reasons = Counter()
    for arbiter, view, _, decision in cases:
        settings, reason, proposed = arbiter.settings, decision.reason, decision.proposed
        reasons[reason] += 1
        if reason in REFUSED:
            assert view.kind[proposed] in REFUSED[reason]
        match reason:
            case Reason.PLANNER_TURN:
                assert decision.proposed_by is Actor.PLANNER
            case Reason.LOW_REWARD:
                assert view.reward[proposed] < settings.r_min
            case Reason.UNSAFE_AHEAD:
                assert settings.veto_horizon == "lookahead"
                assert view.steps[proposed] < SAFE
            case Reason.UNMODELLED:
                assert settings.unmodelled == "veto"
            case Reason.NO_SAFE_ACTION:
                assert "safe" not in view.kind and "unsafe" in view.kind
            case Reason.LEAST_RISK:
                assert "safe" not in view.kind
                assert not {"risky", "certain"}.isdisjoint(view.kind)
            case Reason.NO_APPLICABLE_ACTION:
                assert not any(view.applicable)
                assert decision.executed_by is Actor.FALLBACK
    assert set(reasons) == set(Reason) - {Reason.LITTLE_TRIED, Reason.FEW_WAYS_ON}
    assert min(reasons.values()) >= 5


# Algorithm 1 ------------------------------------------------------------------------------------

TWO = load(text("two"))
STATE = np.array([0.0])[: len(TWO.fluents)]


def two(**settings):
    """An arbiter whose planner always wants action 0."""
    chosen = ArbiterSettings(**settings)
    planner = Lookahead(TWO, PlannerSettings(depth=2))
    return Arbiter(planner, ActionMap(TWO, 2), chosen, Mixture(Settings(arbiter=chosen), 7))


def test_plan_and_judge_proposal_do_not_draw():
    arbiter = two(rho=0.5)
    before = arbiter.state_dict()
    assert arbiter.plan(STATE).reason is Reason.PLANNER_TURN
    assert arbiter.judge_proposal(STATE, Proposal(1, False)).reason is Reason.ACCEPTED
    assert arbiter.state_dict() == before


def test_what_is_tried_for_the_sake_of_learning_is_no_plan():
    """In its turn in training the planner tries something; its plan and all others stay."""
    plain = two(rho=0.0)
    other = 1 - plain.plan(STATE).action
    exploring = Arbiter(
        plain.planner, plain.actions, plain.settings,
        exploration_bonus=lambda forecast: forecast._replace(choice=other),
    )  # fmt: skip
    tried = exploring.decide(STATE, Known([0.0, 1.0]))
    assert (tried.action, tried.reason) == (other, Reason.LITTLE_TRIED)
    assert tried.executed_by is Actor.PLANNER
    assert not tried.vetoed
    assert exploring.explain(tried, STATE) == ""
    assert tried.forecast.choice == exploring.plan(STATE).action == plain.plan(STATE).action
    asked = Arbiter(
        plain.planner, plain.actions, ArbiterSettings(rho=1.0), exploration_bonus=lambda _: 1 / 0
    )
    assert asked.decide(STATE, Known([0.0, 1.0])).executed_by is Actor.LEARNER
