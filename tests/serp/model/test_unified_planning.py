"""The model against unified-planning's reader and simulator.

Well-known domains along a plan that reaches the goal, with whatever else may be done on the way.
"""

from pathlib import Path

import pytest
from unified_planning.engines.sequential_simulator import UPSequentialSimulator
from unified_planning.io import PDDLReader

from serp.model.domain import load_domain, problem_beside
from tests.worlds import DOMAINS

FOLDER = Path(__file__).parent / "pddl_files"
SHIPPED = sorted(DOMAINS.glob("*.pddl"))

# Ground actions by schema, counted by hand, and a plan that reaches the goal with its last action.
CLASSICAL = {
    # driving: 2 trucks, each in its city with 2 x 2 pairs of places
    "logistics": (
        {
            **{"load-truck": 4, "load-airplane": 2, "unload-truck": 4, "unload-airplane": 2},
            **{"drive-truck": 8, "fly-airplane": 4},
        },
        "drive-truck van north-field north-depot north, load-truck parcel van north-depot,"
        " drive-truck van north-depot north-field north, unload-truck parcel van north-field,"
        " fly-airplane jet south-field north-field, load-airplane parcel jet north-field,"
        " fly-airplane jet north-field south-field, unload-airplane parcel jet south-field,"
        " load-truck parcel lorry south-field, drive-truck lorry south-field south-depot south,"
        " unload-truck parcel lorry south-depot",
    ),
    "counters": (
        {"turn-up": 3, "turn-down": 3, "double-step": 3},
        "turn-down first, double-step third, turn-up second, turn-up third, turn-up third",
    ),
    # 10 pairs of neighbours; 3 ways along the aisle in either direction to push
    "warehouse": (
        {"walk": 10, "push": 6},
        "walk niche a2 south, push box a2 a3 a4 east, push box a3 a4 a5 east",
    ),
    # 3 x 2 pairs of different places
    "briefcase": (
        {"move": 6, "put-in": 6, "take-out": 2},
        "put-in dictionary home, move home office, take-out dictionary, move office bank,"
        " take-out paycheck, move bank home",
    ),
}


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore::Warning")  # of unified-planning's parser
def test_another_tool_reads_what_is_shipped(file):
    if not file.stem.endswith("-problem"):
        problem = problem_beside(file)
        PDDLReader().parse_problem(str(file), str(problem) if problem.exists() else None)


@pytest.mark.parametrize("name", CLASSICAL)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_a_known_plan_reaches_the_goal_as_in_unified_planning(name):
    counts, plan = CLASSICAL[name]
    domain = load_domain(FOLDER / f"{name}.pddl")
    model, state = domain.model, domain.model.initial_state
    schemas = [action.schema for action in model.actions]
    assert {schema: schemas.count(schema) for schema in schemas} == counts

    problem = PDDLReader().parse_problem_string(domain.source.text, domain.problem_source.text)
    simulator = UPSequentialSimulator(problem, error_on_failed_checks=False)
    terms = {
        (node.fluent().name, *(str(argument) for argument in node.args)): node
        for node in problem.initial_values
    }

    def simulated(before, step):
        schema, *names = step.split()
        expressions = problem.environment.expression_manager
        objects = tuple(expressions.ObjectExp(problem.object(name)) for name in names)
        return simulator.apply(before, problem.action(schema), objects)

    def check_same(ours, theirs):
        for fluent, value in zip(model.fluents, ours.tolist(), strict=True):
            if fluent.name != "total-cost":  # it reads this one as costs of the actions
                assert theirs.get_value(terms[fluent.key]).constant_value() == value, fluent.name

    expected = simulator.get_initial_state()
    check_same(state, expected)
    steps = plan.split(", ")
    for number, step in enumerate(steps, 1):
        for action in model.actions:  # what may be done here, besides what the plan does
            other, after = model.step(state, action.name), simulated(expected, action.name)
            assert other.applicable == (after is not None), action.name
            if after is not None:
                check_same(other.state, after)
        outcome, expected = model.step(state, step), simulated(expected, step)
        assert outcome.terminal == (number == len(steps)) == simulator.is_goal(expected)
        state = outcome.state
