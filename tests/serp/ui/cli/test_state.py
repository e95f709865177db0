"""The state to plan from: as it is typed, and as it is observed."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

import serp
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.ui.state import observed_state, parse_state
from tests.serp.sample_tasks import CORRIDOR, corridor

MILD = CORRIDOR.replace("(unsafe) (terminal)", "(terminal)")
KNOWN = """
(define (domain known)
  (:constants robot1 kitchen)
  (:predicates (at ?who ?where))
  (:functions (x))
  (:action go :effect (and (at robot1 kitchen) (increase (x) 1))))
"""


def task_of(folder: Path, text: str) -> serp.Task:
    task = corridor(folder)
    Path(str(task.domain)).write_text(text)
    return task


@pytest.mark.parametrize("seed", range(2))
def test_where_the_planner_is_indifferent_the_next_state_is_looked_at(
    tmp_path: Path, seed: int
) -> None:
    """Far from goal and pit nothing differs; the walk goes left until the pit is in sight."""
    task = task_of(tmp_path, MILD)
    planner = serp.MonitorReplanner(task.load().model, depth=1)
    state, origin = observed_state(task, planner, seed)
    first, _ = observed_state(task, None, seed)
    assert planner.plan(first).indifferent
    assert not planner.plan(state).indifferent
    assert f"after a reset with seed {seed} and " in origin
    assert observed_state(task, planner, seed)[0].tolist() == state.tolist()


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
    state, origin = observed_state(task, planner, 2)
    first, expected = observed_state(task, None, 2)
    assert (state.tolist(), origin) == (first.tolist(), expected)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Domain:
    file = tmp_path_factory.mktemp("known") / "known.pddl"
    file.write_text(KNOWN)
    return serp.load_domain(file)


@pytest.mark.parametrize(
    ("text", "state"),
    [
        ("X=1.5,( at  Robot1 kitchen )=true", {"x": 1.5, "at robot1 kitchen": 1.0}),
        ("at robot1 kitchen=False", {"at robot1 kitchen": 0.0}),
        ("at robot1 kitchen=1,", {"at robot1 kitchen": 1.0}),
        ("x=-1.7976931348623157e308", {"x": -1.7976931348623157e308}),
    ],
)
def test_fluents_are_named_as_pddl_has_them(
    known: Domain, text: str, state: dict[str, float]
) -> None:
    assert parse_state([text], known) == state


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
def test_wrong_fluents_are_named(known: Domain, text: str, message: str) -> None:
    with pytest.raises(SerpError) as error:
        parse_state([text], known)
    assert message in str(error.value)


def test_a_state_of_another_form_is_a_usage_error(known: Domain) -> None:
    with pytest.raises(click.UsageError, match="fluent=value"):
        parse_state(["x"], known)
