"""`--task`: tasks that are not installed."""

from __future__ import annotations

from pathlib import Path

from tests.serp.sample_tasks import ROBOT
from tests.serp.ui.cli.conftest import QUICK, Run


def test_a_task_of_ones_own_is_planned_checked_trained_and_measured(run: Run, robot: Path) -> None:
    assert "walkway" not in run("list").stdout
    assert "Chosen:" in run("plan", "--task=my_robot.py", "--observe", "--depth=1").stdout
    assert "fit together" in run("check", "--task=my_robot.py").stdout
    run("plan-and-learn", "--task=my_robot.py", "--episodes=1", "--out=runs/one", *QUICK)
    told = run("evaluate", "runs/one", "--episodes=1", expect=1).stderr
    assert "there is no task `walkway`" in told
    assert "--task FILE.py:FUNCTION" in told
    measured = run("evaluate", "runs/one", "--episodes=1", "--task=my_robot:walkway").stdout
    assert "return" in measured
    shown = run("plan", "runs/one", "--task=my_robot.py").stdout
    assert "Chosen:" in shown and "The model of runs/one is as written" in shown


def test_a_training_that_its_environment_stops_says_where_and_how_it_goes_on(
    run: Run, robot: Path
) -> None:
    broken = ROBOT.replace(
        "make_env=Corridor",
        "make_env=Broken",
    ).replace(
        "def ground",
        "class Broken(Corridor):\n    def reset(self, **_):\n        1 / 0\n\n\ndef ground",
    )
    Path("my_broken.py").write_text(broken)
    told = run("plan-and-learn", "--task=my_broken.py", "--out=runs/one", *QUICK, expect=1).stderr
    assert "reset failed: ZeroDivisionError: division by zero (" in told
    assert "my_broken.py:8)" in told.replace("\n", "")
    assert "serp plan-and-learn --resume runs/one\n" in told
    assert "add --task my_broken.py to the command" in told
