"""`serp plan-and-learn`, and tasks that are not installed."""

import json
import signal
from pathlib import Path

import pytest

from serp.tasks.environment import BoundTask
from tests.serp.runs.runs import rows
from tests.serp.sample_tasks import ROBOT
from tests.serp.ui.cli.conftest import QUICK

TRAIN = ["plan-and-learn", "--domain=cartpole", *QUICK]


def config(folder):
    return json.loads((Path(folder) / "config.json").read_text())["config"]


def test_options_reach_the_run(run):
    options = ["--preset=paper", "--seed=7", "--set=learner.hidden=[8,8]"]
    out = run(*TRAIN, *options, "--env-steps=20", "--out=r", "--quiet").stdout
    assert out == "r\n"
    made = config("r")
    assert (made["preset"], made["seed"]) == ("paper", 7)
    assert made["settings"]["learner"]["hidden"] == [8, 8]
    assert made["settings"]["planner"]["discount"] == 0.9
    assert made["budget"] == {"episodes": None, "env_steps": 20}


def signals_in(monkeypatch, number, *steps):
    """Send a signal to this process in these steps of the environment, counted over all runs."""
    made, whole = iter(range(1, 1_000)), BoundTask.step

    def step(self, action):
        if next(made) in steps:
            signal.raise_signal(number)
        return whole(self, action)

    monkeypatch.setattr(BoundTask, "step", step)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_with_the_episode(number, run, trained, monkeypatch):
    """Ctrl-C, what a scheduler sends, and what a terminal sends that is closed."""
    signals_in(monkeypatch, number, 20)
    shown = run(*TRAIN, "--episodes=4", "--out=r", expect=128 + number).stderr
    assert "everything is saved in r" in shown
    assert "serp plan-and-learn --resume r\n" in shown
    done = rows("r", "metrics")
    assert 1 <= len(done) < 4
    assert done == rows(trained, "metrics")[: len(done)]
    assert Path("r/summary.json").exists()


def test_a_task_of_ones_own_is_planned_checked_trained_and_measured(run, robot):
    assert "walkway" not in run("list").stdout
    assert "Chosen:" in run("plan", "--task=my_robot.py", "--observe", "--depth=1").stdout
    checked = run("check", "--task=my_robot.py").stdout
    assert "no name for environment action `3`" in checked and "declares no time limit" in checked
    begun = run("plan-and-learn", "--task=my_robot.py", "--env-steps=9", "--out=runs/one", *QUICK)
    assert "declares no time limit" in begun.stderr
    assert "serp export runs/one -o FOLDER" in begun.stdout
    for named in ((), ("--task=my_robot:walkway",)):
        assert "mean return" in run("evaluate", "runs/one", "--episodes=1", *named).stdout
    shown = run("plan", "runs/one").stdout
    assert "Chosen:" in shown and "The model of runs/one is as written" in shown
    run("plan-and-learn", "--resume=runs/one", "--episodes=2", "--quiet")


def test_the_code_of_a_task_runs_only_where_the_user_has_run_it(run, robot, monkeypatch):
    run("plan-and-learn", "--task=my_robot.py", "--episodes=1", "--out=one", *QUICK)
    text = robot.read_text()
    robot.write_text("raise SystemExit('executed')\n" + text)
    told = run("evaluate", "one", "--episodes=1", expect=1).stderr
    assert "You have not run this file yet, or it has changed" in told
    assert f"add --task {robot.resolve()}" in told
    robot.write_text(text)
    run("evaluate", "one", "--episodes=1")
    monkeypatch.setenv("XDG_CONFIG_HOME", "somebody-else")
    run("report", "one", expect=1)
    robot.unlink()
    told = run("evaluate", "one", "--episodes=1", expect=1).stderr
    assert f"was made with the task in {robot.resolve()}; give it with --task" in told


def test_a_training_that_its_environment_stops_says_where_and_how_it_goes_on(run, robot):
    broken = ROBOT.replace("make_env=Corridor", "make_env=Broken").replace(
        "def ground",
        "class Broken(Corridor):\n    def reset(self, **_):\n        1 / 0\n\n\ndef ground",
    )
    Path("my_broken.py").write_text(broken)
    told = run("plan-and-learn", "--task=my_broken.py", "--out=runs/one", *QUICK, expect=1).stderr
    assert "reset failed: ZeroDivisionError: division by zero (" in told
    assert "my_broken.py:8)" in told.replace("\n", "")
    assert "serp plan-and-learn --resume runs/one\n" in told
    Path("my_broken.py").write_text(ROBOT)
    told = run("plan-and-learn", "--resume=runs/one", expect=1).stderr
    assert "You have not run this file yet" in told
