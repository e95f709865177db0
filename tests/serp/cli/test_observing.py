"""An observed state has something to choose, where there is such a state."""

from __future__ import annotations

from pathlib import Path

import pytest

import serp
from serp.cli.state import observed, observed_choice
from tests.serp.sample_tasks import CORRIDOR, corridor

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
