"""The state to plan from: as it is typed, and as it is observed."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

import serp
from serp.cli.state import observed, observed_choice, parse_state
from serp.errors import SerpError
from tests.generated.profile import examples
from tests.serp.sample_tasks import CORRIDOR, corridor

KNOWN = {"x": True, "at robot1 kitchen": False}
MILD = CORRIDOR.replace("(unsafe) (terminal)", "(terminal)")


def task_of(folder: Path, text: str) -> serp.Task:
    task = corridor(folder)
    Path(str(task.domain)).write_text(text)
    return task


@pytest.mark.parametrize("seed", range(4))
def test_where_all_actions_promise_the_same_the_next_state_is_looked_at(
    tmp_path: Path, seed: int
) -> None:
    """Far from goal and pit nothing differs; the walk goes left until the pit is in sight."""
    task = task_of(tmp_path, MILD)
    planner = serp.MonitorReplanner(task.load().model, depth=1)
    state, origin = observed_choice(task, planner, seed)
    first, _ = observed(task, seed)
    assert planner.plan(first).indifferent
    assert not planner.plan(state).indifferent
    assert f"after a reset with seed {seed} and " in origin
    assert observed_choice(task, planner, seed)[0].tolist() == state.tolist()


@pytest.mark.parametrize(
    "text",
    [
        MILD.replace("(decrease (reward) 5)", "").replace("(increase (reward) 5)", ""),
        CORRIDOR.replace(":precondition (and)", ":precondition (and (> (x) 99))"),
    ],
    ids=["nothing matters", "one action at most"],
)
def test_where_there_is_nothing_to_choose_the_first_state_is_taken(
    tmp_path: Path, text: str
) -> None:
    task = task_of(tmp_path, text)
    planner = serp.MonitorReplanner(task.load().model, depth=1)
    state, origin = observed_choice(task, planner, 2)
    first, expected = observed(task, 2)
    assert (state.tolist(), origin) == (first.tolist(), expected)


def test_fluents_are_named_as_pddl_has_them() -> None:
    texts = ["X=1.5,( at  Robot1 kitchen )=true"]
    assert parse_state(texts, KNOWN) == {"x": 1.5, "at robot1 kitchen": 1.0}


@pytest.mark.parametrize(("text", "value"), [("true", 1), ("False", 0), ("1", 1), ("0", 0)])
def test_predicates_are_true_or_false(text: str, value: float) -> None:
    assert parse_state([f"at robot1 kitchen={text}"], KNOWN) == {"at robot1 kitchen": value}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("y=1", "unknown fluent `y`"),
        ("at robot1 kitche=1", "did you mean `at robot1 kitchen`?"),
        ("x=fast", "`x` is a finite number, not `fast`"),
        ("x=nan", "`x` is a finite number, not `nan`"),
        ("x=true", "`x` is a finite number, not `true`"),
        ("at robot1 kitchen=2", "`at robot1 kitchen` is true or false, not `2`"),
        ("x=1,x=2", "`x` is given twice"),
    ],
)
def test_wrong_fluents_are_named(text: str, message: str) -> None:
    with pytest.raises(SerpError) as error:
        parse_state([text], KNOWN)
    assert message in str(error.value)


def test_a_state_of_another_form_is_a_usage_error() -> None:
    with pytest.raises(click.UsageError, match="fluent=value"):
        parse_state(["x"], KNOWN)


@examples(200)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_survives(value: float) -> None:
    assert parse_state([f"x={value!r}"], KNOWN) == {"x": value}
