"""Rewards and ends of steps: what is learned of them beside the rules of the file."""

import numpy as np
import pytest

from serp.model.flags import TERMINAL, UNSAFE, going_on
from serp.model.learned.feature_groups import FILE, LINEAR
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Bound
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.serp.model.learned.worlds import GRID, adaptation, adapted

TRACK = """(define (domain track)
  (:predicates (unsafe) (terminal))
  (:functions (x) (reward))
  (:action go :parameters () :precondition (and) :effect (and (increase (x) 0.125)))
  (:action jump :parameters () :precondition (and) :effect (and (unsafe) (increase (x) 0.5)))
  (:event far :parameters () :precondition (and (> (x) 1))
    :effect (and (increase (reward) 4) (terminal))))
"""
"""The file says that the end comes at 1, with a reward of 4."""
GO, JUMP = 0, 1


def end_of(flags):
    """The probability that a step ends the task."""
    return 1.0 if flags & TERMINAL else 1.0 - going_on(flags)


def taught(of, steps, *, right=False):
    """Show steps of a world; return the squared errors `[steps, file and model, reward and end]`.

    There one earns what x is, and the task ends in every other step from 1 on. Where the file is
    `right`, it is as it says.
    """
    rng, errors = np.random.default_rng(0), np.empty((steps, 2, 2))
    for k in range(steps):
        state = rng.uniform(0.0, 2.0, 1)
        after = state + 0.125
        over = after[0] > 1.0 and (right or rng.random() < 0.5)
        reward = 4.0 * (after[0] > 1.0) if right else after[0]
        for m, model in enumerate((of.model.written, of.model)):
            out, flags = model.core.step(state, GO)
            told = np.array([out[-1], end_of(flags)])
            errors[k, m] = (told - (reward, over)) ** 2
        of.observe(state, GO, after, over, reward)
    return errors


def test_reward_and_end_are_those_that_came():
    of = adaptation(TRACK, dt=1.0, mode="rewards")
    errors = taught(of, 2_000)
    assert (errors[:, 1].mean(axis=0) <= errors[:, 0].mean(axis=0)).all()
    file, model = errors[-500:].mean(axis=0)
    assert model[0] < 0.02 * file[0] and model[1] < 0.7 * file[1]
    for x in (0.25, 1.5):
        out, flags = of.model.core.step(np.array([x]), GO)
        assert out[-1] == pytest.approx(x + 0.125, abs=0.3)
        assert not flags & TERMINAL
        assert going_on(flags) == pytest.approx(1.0 if x < 1.0 else 0.5, abs=0.15)
    reward, end = of.adoption.worth
    assert (reward.name, end.name) == ("reward", "terminal")
    assert reward.corrected and end.corrected and "(terminal)" in str(of.adoption)
    assert end.in_use < 0.7 * end.written
    assert sum(each.steps for each in end.reliability) > 1_000
    for each in end.reliability:
        assert each.steps < 100 or each.ended == pytest.approx(each.chance, abs=0.1)


def test_where_the_file_is_right_it_predicts_alone_to_the_bit():
    of = adaptation(TRACK, dt=1.0, mode="rewards")
    assert (taught(of, 600, right=True) == 0.0).all()
    assert of.model.as_written and not any(each.corrected for each in of.adoption.worth)


def test_what_the_file_flags_and_what_is_far_from_the_data_stay_as_they_are():
    of = adaptation(TRACK, dt=1.0, mode="rewards")
    taught(of, 2_000)
    written = of.model.written.core
    for x, action in ((1.5, JUMP), (9.0, GO), (-3.0, GO)):
        (out, flags), (same, by_file) = (
            core.step(np.array([x]), action) for core in (of.model.core, written)
        )
        assert flags == by_file and out[-1] == same[-1]
    assert of.model.core.step(np.array([1.5]), JUMP)[1] & UNSAFE


def test_rewards_that_are_hints_are_kept_and_so_are_the_ends_that_they_come_with():
    of = adaptation(TRACK, dt=1.0)
    taught(of, 2_000)
    reward_and_end = [each.name for each in of.adoption.worth if each.corrected]
    assert reward_and_end == ["terminal"]
    for x in (0.5, 1.5):
        state = np.array([x])
        (out, flags), (same, by_file) = (
            core.step(state, GO) for core in (of.model.core, of.model.written.core)
        )
        assert out[-1] == same[-1] and flags & TERMINAL == by_file & TERMINAL


def test_a_lookahead_goes_on_where_an_end_is_doubtful():
    of = adaptation(TRACK, dt=1.0, mode="rewards")
    taught(of, 2_000)
    settings = PlannerSettings(depth=2, discount=0.5)
    state = np.array([1.5])
    forecast = Lookahead(of.model, settings).forecast(state)
    out, flags = of.model.core.step(state, GO)
    after, _ = of.model.core.step(out[:-1], GO)
    expected = out[-1] + 0.5 * going_on(flags) * after[-1]
    assert forecast.value[GO] == pytest.approx(expected, rel=1e-12)
    assert not forecast.flags[GO] & TERMINAL


def test_counted_outcomes_share_the_chance_of_an_end():
    """A fall that the file foresees is certain less often, and the rest ends by chance."""
    of = adaptation(GRID, dt=1.0, mode="rewards")
    model = adapted(of)
    rng = np.random.default_rng(0)
    for k in range(300):  # `right` slips down the grid in a third of all steps
        state = np.array([0.0, 2.0, float(rng.integers(3))])
        slips = rng.random() < 1 / 3
        over = slips and k > 30  # until then the task goes on
        of.observe(state, 0, state + ((0, 1, 0) if slips else (0, 0, 1)), over)
    state = np.array([0.0, 2.0, 1.0])
    worth = model.worth
    assert worth is not None
    worth.kinds = np.array([FILE, FILE])
    before = model.core.outcomes(state, 0)
    assert len(before) > 1
    ends = (before[:, -2].astype(np.int64) & TERMINAL) != 0
    chance = before[ends, -1].sum()
    assert 0.2 < chance < 0.5
    worth.typical[:], worth.shrink[:], worth.linear[:] = 1.0, 0.0, 0.0
    for change in (-0.1, 0.25):
        worth.linear[:, LINEAR - 1, :, 0] = (2.0, change)
        worth.kinds = np.array([LINEAR, LINEAR])
        rows = model.core.outcomes(state, 0)
        flags = rows[:, -2].astype(np.int64)
        safe = (flags & UNSAFE) == 0
        now = (rows[:, -1] * [end_of(each) for each in flags.tolist()]).sum()
        assert (rows[safe, -3] == before[safe, -3] + 2.0).all()
        assert (rows[~safe, -3] == before[~safe, -3]).all()
        if change > 0.0:
            assert now == pytest.approx(chance + change, abs=1e-4)
    worth.kinds = np.array([FILE, FILE])
    assert model.core.outcomes(state, 0).tobytes() == before.tobytes()


CLIFF = """(define (domain cliff)
  (:predicates (unsafe))
  (:functions (x) (reward))
  (:action go :parameters () :precondition (< (x) 3) :effect (and (increase (x) 1)
    (increase (reward) 1) (when (>= (x) 2) (unsafe))))
  (:action back :parameters () :precondition (= (x) 1) :effect (decrease (x) 1)))
"""
"""From 2 on every action is unsafe."""


def test_a_learned_end_hides_nothing_unsafe():
    model = adapted(adaptation(CLIFF))
    for planner in (FarSightPlanner(model, PlannerSettings()), Lookahead(model)):
        model.worth.kinds = np.zeros(2, np.int64)
        assert planner.forecast(np.array([1.0])).choice == 1
    worth = model.worth
    worth.centre[:], worth.shrink[:], worth.typical[:] = 1.0, 0.1, 1.0
    worth.linear[:, 0, 1, 0] = 1.0  # every step ends the task
    worth.kinds = np.array([FILE, LINEAR])
    assert going_on(model.core.step(np.array([1.0]), GO)[1]) == 0.0
    for planner in (FarSightPlanner(model, PlannerSettings()), Lookahead(model)):
        forecast = planner.forecast(np.array([1.0]))
        assert (forecast.choice, forecast.safe_steps[GO]) == (1, 1)
        assert forecast.path_risk[GO] > 0.9  # a graph discounts it


def test_a_graph_of_a_former_model_does_not_say_what_is_safe():
    """Though nothing is planned, so that nothing pays for another graph."""
    model = adapted(adaptation(CLIFF))
    planner = FarSightPlanner(model, PlannerSettings())
    assert planner.forecast(np.array([0.0])).bound is Bound.EXHAUSTED
    planner._saved = -10_000
    assert planner.check_safety(np.array([0.0])) is not None
    model.revision += 1
    assert planner.check_safety(np.array([0.0])) is None
