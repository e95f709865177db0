"""Plans of other planners: followed while they hold, never believed unchecked."""

import functools

import numpy as np
import pytest

from serp.errors import RunError
from serp.planning.plan_follower import AdvisedPlanner, PlanFollower
from serp.settings import PlannerSettings
from tests.generated import Texts, load_texts
from tests.worlds import text

FERRY = text("ferry")
CROSS = text("ferry-problem")
WAY = ("sail a b", "sail b c", "load c", "sail c b", "sail b a", "unload a")
SETTINGS = PlannerSettings(depth=2)


@functools.cache
def ferry():
    return load_texts(Texts(FERRY, CROSS)).model


def follower(*names):
    """A follower whose engine always returns the same plan; none where no action is named."""
    plan = [ferry().action_index(name) for name in names]
    return PlanFollower(ferry(), SETTINGS, lambda state: plan or None)


def drive(planner, moves, state):
    """Return the actions that are chosen; those for which `moves` is false do nothing."""
    names = []
    for works in moves:
        choice = planner.forecast(state).choice
        names.append(ferry().actions[choice].name)
        if works:
            state = ferry().step(state, choice).state
    assert ferry().at_goal(state)
    return names


def test_an_action_that_failed_is_repeated_without_another_search():
    planner = follower(*WAY)
    moves = (True, False, False, True, True, False, True, True, True)
    repeated = [WAY[0], *[WAY[1]] * 3, WAY[2], *[WAY[3]] * 2, WAY[4], WAY[5]]
    assert drive(planner, moves, ferry().initial_state) == repeated
    assert planner.searches == 1


def test_the_shortest_rest_of_the_plan_that_holds_is_followed():
    planner = follower(*WAY)
    planner.forecast(ferry().initial_state)
    carried = ferry().state({**dict.fromkeys((f.name for f in ferry().fluents), False),
                             "at c": True, "loaded": True, "wet": True})  # fmt: skip
    assert drive(planner, [True] * 3, carried) == list(WAY[3:])
    assert planner.searches == 1


@pytest.mark.parametrize(
    "plan",
    [
        (),
        WAY[:-1],  # does not reach the goal
        (WAY[0], *WAY[2:]),  # an action that is not applicable
        ("jump", *WAY),  # flagged
    ],
)
def test_no_plan_is_believed_unchecked(plan):
    planner, alone = follower(*plan), follower()
    for _ in range(7):
        found, own = planner.forecast(ferry().initial_state), alone.forecast(ferry().initial_state)
        assert found.choice == own.choice and np.array_equal(found.value, own.value)
        assert planner.plan == ()
    assert planner.searches == 3  # at decisions 1, 3 and 7: less and less often


def test_without_a_goal_a_plan_leads_to_an_end_with_a_reward():
    text = (
        FERRY.replace("(unsafe)", "(unsafe) (terminal)", 1)[:-2]
        + """
  (:event done :parameters () :precondition (and (cargo a)) :effect (and (terminal) {}))
  (:event sunk :parameters () :precondition (and (wet)) :effect (and (terminal))))"""
    )
    for reward, followed in (("(increase (reward) 1)", WAY), ("(decrease (reward) 1)", ())):
        domain = text.replace("{}", reward).replace("(:action", "(:functions (reward)) (:action", 1)
        model = load_texts(Texts(domain, CROSS.replace("(cargo a)", ""))).model
        plan = [model.action_index(name) for name in WAY]
        planner = PlanFollower(model, SETTINGS, lambda state, plan=plan: plan)
        planner.forecast(model.initial_state)
        assert tuple(model.actions[k].name for k in planner.plan) == followed


def test_a_follower_continues_as_saved():
    planner, other = follower(*WAY), follower()
    planner.forecast(ferry().initial_state)
    other.load_state_dict(*planner.state_dict())
    assert drive(other, [False] + [True] * 6, ferry().initial_state) == [WAY[0], *WAY]
    assert drive(other, [True] * 6, ferry().initial_state) == list(WAY)  # another episode
    assert other.searches == 1
    arrays, meta = planner.state_dict()
    with pytest.raises(RunError, match="plan has values"):
        other.load_state_dict(arrays | {"plan": arrays["plan"] + 99}, meta)


@pytest.mark.parametrize(("advice", "chosen"), [("jump", False), ("sail a b", True)])
def test_advice_never_prevails_over_risk(advice, chosen):
    model = ferry()
    found = AdvisedPlanner(model, SETTINGS, lambda state: model.action_index(advice)).forecast(
        ferry().initial_state
    )
    assert (model.actions[found.choice].name == advice) == chosen
    assert not (chosen and found.indifferent)
