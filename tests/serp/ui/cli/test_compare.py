"""`serp compare`."""

import os
import signal
from pathlib import Path

import pytest
from click.testing import CliRunner

from serp.runs.comparison import pool
from serp.ui.root import serp

COMPARE = [
    "compare",
    "--domain=cartpole",
    "--env-steps=60",
    "--evaluation-episodes=1",
    "--final-episodes=1",
    "--seeds=1",
    "--jobs=1",
    "--set=planner.depth=2",
    # Falls soon: a full episode would be longer than the budget.
    "--set=arbiter.rho=1",
    "--set=arbiter.veto_horizon=step",
]


@pytest.fixture(autouse=True)
def _without_pictures(monkeypatch):
    monkeypatch.setattr("serp.runs.comparison.report.render", lambda figure, kind: b"<svg/>")


def test_names_and_seeds_may_be_apart_by_commas(monkeypatch):
    names = "serp,dqn:learner.hidden=[8,8];learner.members=1, serp:arbiter.r_min=none"
    asked = {}

    def compare(task, **options):
        asked.update(options)
        raise KeyboardInterrupt

    monkeypatch.setattr("serp.runs.comparison.compare.compare", compare)
    words = [f"--algorithms={names}", "--algorithms=mrp@x", "--seeds=0-1, 9"]
    assert CliRunner().invoke(serp, ["compare", "--domain=cartpole", *words]).exit_code == 130
    assert asked["seeds"] == [0, 1, 9]
    assert asked["algorithms"] == [
        "serp", "dqn:learner.hidden=[8,8];learner.members=1", "serp:arbiter.r_min=none", "mrp@x",
    ]  # fmt: skip


def test_ctrl_c_keeps_what_is_there_and_says_how_to_go_on(run, monkeypatch):
    def pressing(job, stopped):
        run_trial(job, stopped)
        os.kill(os.getpid(), signal.SIGINT)

    run_trial = pool.run_trial
    monkeypatch.setattr(pool, "run_trial", pressing)
    arguments = [*COMPARE, "--algorithms=mrp,dqn", "--out=c"]
    stopped = run(*arguments, expect=130)
    assert "stopped with 1 of 2 trials complete in c" in stopped.stderr
    assert "Continue with the same command" in stopped.stderr
    assert Path("c/report.html").exists()
    monkeypatch.setattr(pool, "run_trial", run_trial)
    assert "[1/1] dqn, seed 0" in run(*arguments).stderr
