"""The model against unified-planning's reader and simulator.

Well-known domains along a plan that reaches the goal, with whatever else may be done on the way.
"""

from __future__ import annotations

import warnings
from fractions import Fraction
from pathlib import Path

import pytest
from unified_planning.engines.sequential_simulator import UPSequentialSimulator
from unified_planning.io import PDDLReader
from unified_planning.model import FNode, Problem, UPState

from serp.model.loading import load_domain
from serp.model.transition_model import TransitionModel, Vector
from tests.generated import Texts

FOLDER = Path(__file__).parent / "pddl_files"
Key = tuple[str, ...]
Values = dict[Key, bool | Fraction]


def read(texts: Texts) -> Problem:
    """Read a domain and its problem."""
    with warnings.catch_warnings():  # it uses old names of pyparsing
        warnings.simplefilter("ignore", DeprecationWarning)
        return PDDLReader().parse_problem_string(texts.domain, texts.problem)


class Simulator:
    """Steps a problem with `UPSequentialSimulator`, over plain dictionaries."""

    def __init__(self, texts: Texts) -> None:
        self.problem = read(texts)
        self.expressions = self.problem.environment.expression_manager
        with warnings.catch_warnings():  # it says that it does not know processes and events
            warnings.simplefilter("ignore", UserWarning)
            self.simulator = UPSequentialSimulator(self.problem, error_on_failed_checks=False)
        self.terms: dict[Key, FNode] = {
            (node.fluent().name, *(str(argument) for argument in node.args)): node
            for node in self.problem.initial_values
        }

    def initial(self) -> Values:
        """The problem's initial state."""
        return self.spelled(self.simulator.get_initial_state())

    def spelled(self, state: UPState) -> Values:
        values = {key: state.get_value(node) for key, node in self.terms.items()}
        return {key: value.constant_value() for key, value in values.items()}

    def state(self, values: Values) -> UPState:
        constants = self.expressions.auto_promote([values[key] for key in self.terms])
        return UPState(dict(zip(self.terms.values(), constants, strict=True)), self.problem)

    def step(self, values: Values, action: str) -> Values | None:
        """Return the next state, or None where the action, such as `move a b`, has none."""
        name, *arguments = action.split()
        schema = self.problem.action(name)
        objects = tuple(
            self.expressions.ObjectExp(self.problem.object(argument)) for argument in arguments
        )
        state = self.state(values)
        if not self.simulator.is_applicable(state, schema, objects):
            return None
        after = self.simulator.apply(state, schema, objects)
        return None if after is None else self.spelled(after)

    def goal_reached(self, values: Values) -> bool:
        """Whether the problem's goal holds."""
        return self.simulator.is_goal(self.state(values))


def in_fractions(model: TransitionModel, state: Vector) -> Values:
    """A state of the model, exactly, as the simulator has it (static values left out)."""
    return {
        f.key: Fraction(value) if f.numeric else bool(value)
        for f, value in zip(model.fluents, state.tolist(), strict=True)
    }


# Ground actions by schema, counted by hand, and a plan that reaches the goal with its last action.
CLASSICAL = {
    # 3 blocks, or 3 x 3 pairs: nothing forbids `stack a a`, though it never applies
    "blocksworld": (
        {"pick-up": 3, "put-down": 3, "stack": 9, "unstack": 9},
        "unstack c a, put-down c, pick-up b, stack b c, pick-up a, stack a b",
    ),
    # 2 rooms, 3 balls, 2 hands: the static predicates leave out all the rest of 7 objects
    "gripper": (
        {"move": 4, "pick": 12, "drop": 12},
        "pick red here left, pick green here right, move here there, drop red there left,"
        " drop green there right, move there here, pick blue here left, move here there,"
        " drop blue there left",
    ),
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


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_known_plan_reaches_the_goal_as_in_unified_planning(name: str) -> None:
    counts, plan = CLASSICAL[name]
    domain = load_domain(FOLDER / f"{name}.pddl")
    assert domain.problem_source is not None
    model = domain.model
    schemas = [action.schema for action in model.actions]
    assert {schema: schemas.count(schema) for schema in schemas} == counts

    simulator = Simulator(Texts(domain.source.text, domain.problem_source.text))
    expected = simulator.initial()
    state = model.initial_state
    assert state is not None

    def agree(found: Vector, simulated: Values) -> bool:
        ours = in_fractions(model, found)
        ours.pop(("total-cost",), None)  # it reads this one as costs of the actions
        return simulated | ours == simulated

    assert agree(state, expected)
    steps = plan.split(", ")
    for number, step in enumerate(steps, 1):
        for action in model.actions:  # what may be done here, besides what the plan does
            after = simulator.step(expected, action.name)
            other = model.step(state, action.name)
            assert other.applicable == (after is not None), action.name
            if after is not None:
                assert agree(other.state, after), action.name
        expected_after = simulator.step(expected, step)
        assert expected_after is not None
        outcome = model.step(state, step)
        assert outcome.terminal == (number == len(steps)) == simulator.goal_reached(expected_after)
        state, expected = outcome.state, expected_after
