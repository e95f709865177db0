"""Planners of a task's own: functions of the fluents' values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from serp.errors import SerpError, SettingsError, TaskError
from serp.runs.run import Run
from serp.runs.train import plan_and_learn
from tests.serp.runs.runs import everything, resume, without_pictures
from tests.serp.sample_tasks import corridor

PLANNERS: dict[str, Any] = {
    "rightwards": lambda state: "right",
    "up-and-away": lambda state: "up",
    "blind": lambda state: state["y"],
}


@without_pictures()
def train(folder: Path, out: Path, planner: str, episodes: int) -> Run:
    return plan_and_learn(
        corridor(folder, planners=PLANNERS),
        settings={"planner": {"name": planner, "depth": 2}},
        episodes=episodes,
        seed=3,
        out=out,
        quiet=True,
    )


def test_a_run_with_a_planner_of_its_own_resumes_as_if_uninterrupted(tmp_path: Path) -> None:
    run = train(tmp_path, tmp_path / "whole", "rightwards", 6)
    assert run.evaluate("planner", episodes=1, quiet=True).returns
    train(tmp_path, tmp_path / "half", "rightwards", 3)
    resume(corridor(tmp_path, planners=PLANNERS), tmp_path / "half", episodes=6)
    assert everything(tmp_path / "half") == everything(tmp_path / "whole")


@pytest.mark.parametrize(
    ("planner", "failure", "message"),
    [
        ("up-and-away", TaskError, "planner `up-and-away` advises 'up': unknown action `up`"),
        ("blind", TaskError, "planner `blind`: KeyError: 'y'"),
        ("rightward", SettingsError, "no planner `rightward`; did you mean `rightwards`"),
    ],
)
def test_a_planner_that_cannot_be_used_is_refused(
    tmp_path: Path, planner: str, failure: type[SerpError], message: str
) -> None:
    with pytest.raises(failure, match=message):
        train(tmp_path, tmp_path / "run", planner, 2)
