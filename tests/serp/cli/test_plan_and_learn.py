"""`serp plan-and-learn`."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from serp.task import BoundTask
from tests.serp.cli.conftest import QUICK, Run

TRAIN = ["plan-and-learn", "--domain=cartpole", *QUICK]


def config(folder: str | Path) -> Any:
    return json.loads((Path(folder) / "config.json").read_text())["config"]


def rows(folder: str | Path, table: str) -> list[dict[str, str]]:
    """A table of a run, but for the time it took."""
    with open(Path(folder) / f"{table}.csv", newline="") as file:
        return [{**row, "wall_time": ""} for row in csv.DictReader(file)]


def test_the_end_says_what_came_out_and_what_to_do_next(run: Run) -> None:
    result = run(*TRAIN, "--episodes=3", "--out=first run")
    assert "3 episodes" in result.stdout
    for word in ("return", "terminated", "vetoes", "unsafe"):
        assert f"\n{word} " in result.stdout
    assert "serp evaluate 'first run'" in result.stdout
    assert "serp plan --domain cartpole" in result.stdout
    assert "episode 3/3" in result.stderr


def test_options_reach_the_run(run: Run) -> None:
    options = ["--preset=paper", "--seed=7", "--set=learner.hidden=[8,8]"]
    out = run(*TRAIN, *options, "--env-steps=20", "--out=r", "--quiet").stdout
    assert out == "r\n"
    made = config("r")
    assert (made["preset"], made["seed"]) == ("paper", 7)
    assert made["settings"]["learner"]["hidden"] == [8, 8]
    assert made["settings"]["learner"]["discount"] == 0.9
    assert made["budget"] == {"episodes": None, "env_steps": 20}


def test_a_run_without_a_name_gets_one(run: Run) -> None:
    out = run(*TRAIN, "--episodes=1", "--quiet").stdout.strip()
    assert Path(out).parent == Path("runs")
    assert Path(out).name.startswith("cartpole-")
    assert config(out)["task"] == "cartpole"


@pytest.mark.parametrize("how", [["--resume", "r"], ["--out", "r", "--resume"], ["--resume=r"]])
def test_resuming_needs_nothing_but_the_run(how: list[str], run: Run) -> None:
    run(*TRAIN, "--episodes=2", "--out=r", "--seed=5", "--quiet")
    run(*TRAIN, "--episodes=4", "--out=whole", "--seed=5", "--quiet")
    run("plan-and-learn", *how, "--episodes=4", "--quiet")
    assert rows("r", "metrics") == rows("whole", "metrics")
    assert rows("r", "decisions") == rows("whole", "decisions")


def test_resuming_a_finished_run_does_nothing_and_says_so(run: Run) -> None:
    run(*TRAIN, "--episodes=2", "--out=r", "--quiet")
    result = run("plan-and-learn", "--resume=r")
    assert "Nothing was left to do." in result.stderr
    assert len(rows("r", "metrics")) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give --domain"),
        (["--resume"], "give the run to continue"),
        (["--resume=a", "--out=b"], "which run: --resume a or --out b?"),
        (["--resume=a", "--seed=1"], "--seed cannot change"),
        (["--resume=a", "--preset=paper"], "--preset cannot change"),
        (["--resume=a", "--set=planner.depth=3"], "--set cannot change"),
        (["--domain=cartpole", "--episodes=0"], "is not in the range"),
        (["--domain=cartpole", "--set=depth=3"], "expected section.name=value"),
    ],
)
def test_usage_errors(arguments: list[str], message: str, run: Run) -> None:
    assert message in run("plan-and-learn", *arguments, expect=2).stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--domain=cartpol"], "did you mean `cartpole`?"),
        (["--domain=nosuch/file.pddl"], "there is no such domain file"),
        (["--domain=cartpole", "--preset=papr"], "did you mean `paper`?"),
        (["--domain=cartpole", "--set=planer.depth=3"], "did you mean `planner`?"),
        (["--domain=cartpole", "--set=planner.dept=3"], "did you mean `depth`?"),
        (["--domain=cartpole", "--set=planner.depth=deep"], "planner: depth must be"),
        (["--domain=cartpole", "--set=arbiter.r_min=low"], "arbiter: r_min must be"),
        (["--domain=cartpole", "--set=arbiter.rho=low"], "arbiter: "),
        (["--resume=nosuch"], "no such folder"),
    ],
)
def test_mistakes_leave_nothing_behind(arguments: list[str], message: str, run: Run) -> None:
    assert message in run("plan-and-learn", *arguments, expect=1).stderr
    assert list(Path().iterdir()) == []


def test_an_existing_run_is_left_alone(run: Run, trained: Path) -> None:
    before = {path: path.read_bytes() for path in trained.iterdir()}
    message = run(*TRAIN, f"--out={trained}", expect=1).stderr
    assert "holds a run already" in message
    assert {path: path.read_bytes() for path in trained.iterdir()} == before


def test_a_run_of_another_task_is_not_continued(run: Run, trained: Path) -> None:
    Path("other.pddl").write_text("(define (domain other))")
    message = run("plan-and-learn", f"--resume={trained}", "--domain=other.pddl", expect=1).stderr
    assert "no task is installed for domain `other`" in message


def test_an_environment_that_fails_says_how_to_continue(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = BoundTask.step
    steps = iter(range(60))

    def failing(self: BoundTask, action: int) -> Any:
        if next(steps, None) is None:
            from serp.errors import EnvironmentFailure

            raise EnvironmentFailure("the cable came loose")
        return whole(self, action)

    monkeypatch.setattr(BoundTask, "step", failing)
    message = run(*TRAIN, "--episodes=9", "--out=r", expect=1).stderr
    assert "the cable came loose" in message
    assert "serp plan-and-learn --resume r" in message
    monkeypatch.undo()
    run("plan-and-learn", "--resume=r", "--quiet")
    assert len(rows("r", "metrics")) == 9


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT can be sent there")
@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_leaves_a_run_that_can_be_continued(times: int, run: Run) -> None:
    """The continued run equals one that nobody stopped, after one Ctrl-C and after two."""
    run(*TRAIN, "--episodes=12", "--out=whole", "--seed=2", "--quiet")
    process = subprocess.Popen(
        [sys.executable, "-m", "serp", *TRAIN, "--episodes=12", "--out=r", "--seed=2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    metrics = Path("r/metrics.csv")
    deadline = time.monotonic() + 60
    while not metrics.exists() or metrics.read_text().count("\n") < 3:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    for _ in range(times):
        process.send_signal(signal.SIGINT)
        time.sleep(0.02)
    _, shown = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in shown
    assert "serp plan-and-learn --resume r" in shown
    assert len(rows("r", "metrics")) < 12
    run("plan-and-learn", "--resume=r", "--quiet")
    assert rows("r", "metrics") == rows("whole", "metrics")
    assert rows("r", "decisions") == rows("whole", "decisions")
