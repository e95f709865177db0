"""Our planner as an engine of unified-planning, on the problems of its own tests."""

from fractions import Fraction

import pytest
from unified_planning.engines import PlanGenerationResultStatus, SequentialPlanValidator
from unified_planning.engines.sequential_simulator import UPSequentialSimulator
from unified_planning.model import InstantaneousAction, Problem
from unified_planning.model.metrics import MinimizeActionCosts
from unified_planning.shortcuts import Equals, Int, IntType, RealType
from unified_planning.test.examples import get_example_problems

from serp_adapters.unified_planning.engine import SErPEngine
from serp_adapters.unified_planning.selector import SErPSelector

Status = PlanGenerationResultStatus
EXAMPLES = get_example_problems()
SUPPORTED = [name for name, case in EXAMPLES.items() if SErPEngine.supports(case.problem.kind)]


def solved(problem):
    return SErPEngine().solve(problem)


def test_examples_of_unified_planning_that_are_supported_are_solved():
    assert len(SUPPORTED) >= 35
    for name in SUPPORTED:
        case = EXAMPLES[name]
        result = solved(case.problem)
        if case.solvable:
            assert result.status is Status.SOLVED_SATISFICING, name
            assert SequentialPlanValidator().validate(case.problem, result.plan), name
        else:
            assert result.status is Status.UNSOLVABLE_PROVEN, name


def counting(step, to, numbers, name="reward"):
    """A problem in which a word of ours, or of the writer, is a fluent like any other."""
    problem = Problem("counting")
    counted = problem.add_fluent(name, numbers, default_initial_value=0)
    count = InstantaneousAction("count")
    count.add_precondition(counted() < 6 if numbers.is_int_type() else counted() < Fraction(1, 2))
    count.add_increase_effect(counted, step)
    problem.add_action(count)
    problem.add_goal(Equals(counted(), to))
    problem.add_quality_metric(MinimizeActionCosts({count: Int(1)}))
    return problem


def test_unsolvable_is_said_to_be_proven_only_where_numbers_are_exact():
    even = counting(2, 4, IntType())
    assert [str(a) for a in solved(even).plan.actions] == ["count", "count"]
    assert solved(counting(2, 3, IntType())).status is Status.UNSOLVABLE_PROVEN
    # 0.1 + 0.1 + 0.1 is 0.3, and 0.30000000000000004 in floating point
    tenths = counting(Fraction(1, 10), Fraction(3, 10), RealType())
    assert solved(tenths).status is Status.UNSOLVABLE_INCOMPLETELY


@pytest.mark.parametrize(
    "name", ["hierarchical_blocks_world", "robot_fluent_of_user_type", "total-cost"]
)
def test_actions_are_chosen_by_what_is_observed(name):
    own = counting(1, 3, IntType(), name)
    problem = EXAMPLES[name].problem if name in EXAMPLES else own
    selector, simulator = SErPSelector(problem), UPSequentialSimulator(problem)
    state, steps = simulator.get_initial_state(), 0
    while not simulator.is_goal(state):
        action = selector.get_action()
        if steps % 2:  # every other action fails, and this is observed
            state = simulator.apply(state, action)
        selector.update({fluent: state.get_value(fluent) for fluent in problem.initial_values})
        steps += 1
    assert steps == 2 * len(solved(problem).plan.actions)
