"""Well-known domains, read from files and stepped along a plan, with unified-planning beside."""

from __future__ import annotations

from pathlib import Path

import pytest

from serp.model.loading import load_domain
from serp.model.transition_model import Vector
from tests.generated import Texts
from tests.serp.model.simulator import Simulator, in_fractions, read

FOLDER = Path(__file__).parent / "pddl_files"

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

    simulator = Simulator(read(Texts(domain.source.text, domain.problem_source.text)))
    expected = simulator.initial()
    state = model.initial_state
    assert state is not None

    def agree(found: Vector, simulated: dict) -> bool:
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


def test_static_predicates_and_functions_take_no_column() -> None:
    columns = {
        name: {f.symbol for f in load_domain(FOLDER / f"{name}.pddl").model.fluents}
        for name in CLASSICAL
    }
    assert columns["gripper"] == {"at-robby", "at", "free", "carry"}
    assert columns["logistics"] == {"at", "in"}
    assert columns["warehouse"] == {"robot-at", "crate-at", "empty"}
    assert columns["counters"] == {"value", "step", "total-cost"}


def test_a_metric_to_minimize_is_a_cost() -> None:
    model = load_domain(FOLDER / "counters.pddl").model
    assert model.initial_state is not None
    assert model.rewarding
    assert model.step(model.initial_state, "turn-up first").reward == -1.0
    assert model.step(model.initial_state, "double-step first").reward == -0.25
    assert "(limit)" not in {f"({f.name})" for f in model.fluents}
    assert model.ground.static == {"limit": 8.0}


def test_the_car_drives_as_computed_by_hand() -> None:
    model = load_domain(FOLDER / "car.pddl").model
    state = model.initial_state
    assert state is not None

    def values() -> tuple[float, ...]:
        return tuple(model.values(state)[k] for k in ("distance", "speed", "acceleration"))

    assert not model.step(state, "accelerate").applicable
    # Every rate is taken from the state after the action, before any of them is applied.
    for action, expected in [
        ("start", (0.0, 0.0, 0.0)),
        ("accelerate", (0.0, 1.0, 1.0)),
        ("accelerate", (1.0, 1 + 2 - 0.125, 2.0)),
        ("wait", (1 + 2.875, 2.875 + 2 - 0.359375, 2.0)),
    ]:
        outcome = model.step(state, action)
        assert outcome.applicable and not outcome.terminal and not outcome.unsafe
        state = outcome.state
        assert values() == expected
    assert not model.step(state, "accelerate").applicable
    # distance 3.875 + 4.515625; the speed stays below 6 when braking, and rises above it if not
    finish = model.step(state, "brake")
    assert (finish.reward, finish.unsafe, finish.terminal) == (5.0, False, True)
    assert model.values(finish.state)["distance"] == 8.390625
    state = model.step(state, "wait").state
    assert values() == (8.390625, 4.515625 + 2 - 0.564453125, 2.0)
    broken = model.step(state, "wait")
    assert (broken.reward, broken.unsafe, broken.terminal) == (-5.0, True, True)
    assert model.values(broken.state)["acceleration"] == 0.0
    assert not model.step(broken.state, "start").applicable


def test_a_shorter_control_period_makes_smaller_steps() -> None:
    model = load_domain(FOLDER / "car.pddl").model.replace(dt=0.125)
    state = model.state(
        {"running": True, "broken": False, "distance": 0.0, "speed": 4.0, "acceleration": 1.0}
    )
    after = model.values(model.step(state, "wait").state)
    assert (after["distance"], after["speed"]) == (0.5, 4.0 + 0.125 - 0.0625)


def test_the_goal_ends_the_task_only_while_it_holds() -> None:
    model = load_domain(FOLDER / "blocksworld.pddl").model
    state = model.state(
        {f.name: f.name in ("on a b", "on b c", "on-table c", "clear a") for f in model.fluents}
        | {"arm-empty": True}
    )
    assert not model.step(state, "unstack a b").terminal
    assert model.step(model.step(state, "unstack a b").state, "stack a b").terminal
