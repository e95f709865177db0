"""What a newcomer does, in an empty folder, with the command as it is installed."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from serp.cli.root import serp as command

SHIPPED = Path(__file__).resolve().parent.parent / "domains" / "cartpole.pddl"
# An untrained learner acts without help: short episodes, little to wait for.
QUICK = [
    "--domain=cartpole", "--seed=2", "--set=arbiter.rho=1", "--set=planner.depth=1",
    "--set=arbiter.exploration_slack=null", "--set=training.checkpoint_seconds=0",
]  # fmt: skip


def serp(folder: Path, *arguments: str, expect: int = 0) -> Result:
    """Run a command in a folder, in this process."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(command, arguments)
    assert done.exit_code == expect, done.output
    assert "Traceback" not in done.stderr
    return done


def installed(folder: Path, *arguments: str) -> str:
    """Run a command in a folder, in a process of its own, as a user does."""
    done = subprocess.run(
        [sys.executable, "-m", "serp", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rows(run: Path, table: str) -> list[dict[str, str]]:
    """A table of a run, but for the time it took."""
    with open(run / f"{table}.csv", newline="") as file:
        return [{**row, "wall_time": ""} for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the newcomer works."""
    return tmp_path_factory.mktemp("first use")


@pytest.fixture(scope="module")
def whole(folder: Path) -> Path:
    """A run that nobody stopped."""
    shown = installed(folder, "plan-and-learn", *QUICK, "--episodes=9", "--out=whole")
    assert "serp evaluate whole" in shown
    return folder / "whole"


def test_a_run_leaves_everything_a_reader_wants(whole: Path) -> None:
    names = {path.name for path in whole.iterdir()}
    assert {"config.json", "domain.pddl", "metrics.csv", "decisions.csv", "summary.json",
            "report.md", "learning-curve.png", "checkpoint.safetensors"} <= names  # fmt: skip
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["episodes"] == len(rows(whole, "metrics")) == 9


def test_an_edit_in_the_working_directory_takes_effect(tmp_path: Path) -> None:
    def rewards() -> Any:
        shown = json.loads(serp(tmp_path, "plan", "--domain=cartpole", "--json").stdout)
        return [action["reward"] for action in shown["actions"]]

    before = rewards()
    (tmp_path / "domains").mkdir()
    text = SHIPPED.read_text()
    assert "(increase (reward) 1.0)" in text
    edited = text.replace("(increase (reward) 1.0)", "(increase (reward) 6.0)")
    (tmp_path / "domains" / "cartpole.pddl").write_text(edited)
    assert rewards() == pytest.approx([reward + 5.0 for reward in before])


def test_a_misspelt_function_is_pointed_at(tmp_path: Path) -> None:
    text = SHIPPED.read_text()
    line = text[: text.index("(* 15.8 (pole-angle))")].count("\n") + 1
    column = len(text.splitlines()[line - 1].split("pole-angle")[0]) + 1
    wrong = text.replace("(* 15.8 (pole-angle))", "(* 15.8 (pole-angel))")
    (tmp_path / "mine.pddl").write_text(wrong)
    for arguments in (["check", "mine.pddl"], ["plan-and-learn", "--domain=mine.pddl"]):
        message = serp(tmp_path, *arguments, expect=1).stderr
        assert f"mine.pddl:{line}:{column}: unknown function `pole-angel`" in message
        assert "^^^^^^^^^^" in message
        assert "did you mean `pole-angle`?" in message
    assert not (tmp_path / "runs").exists()


class Terminal:
    """A terminal that somebody reads, until it is closed."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()

    def enter(self) -> None:
        """Make it the terminal of the session that the calling process leads."""
        os.close(os.open(os.ttyname(self.slave), os.O_RDWR))

    def read(self) -> None:
        """Read what is there."""
        while select.select([self.master], [], [], 0)[0]:
            os.read(self.master, 65536)


@pytest.mark.skipif(os.name == "nt", reason="no such signals there")
def test_a_run_that_a_signal_stops_goes_on_as_if_nothing_had_been(whole: Path) -> None:
    """Ctrl-C, a scheduler's SIGTERM, and a terminal that is closed under it."""
    folder, terminal = whole.parent, Terminal()

    def begin(name: str, where: int, **options: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "serp", "plan-and-learn", *QUICK, "--episodes=9",
             f"--out={name}"], cwd=folder, stdout=where, stderr=where, text=True, **options,
        )  # fmt: skip

    pressed, scheduled = (begin(name, subprocess.PIPE) for name in ("pressed", "scheduled"))
    closed = begin("closed", terminal.slave, start_new_session=True, preexec_fn=terminal.enter)
    os.close(terminal.slave)
    ends = {
        "pressed": (pressed, 130, lambda: pressed.send_signal(signal.SIGINT)),
        "scheduled": (scheduled, 143, lambda: scheduled.send_signal(signal.SIGTERM)),
        "closed": (closed, 129, lambda: os.close(terminal.master)),
    }
    waiting, deadline = set(ends), time.monotonic() + 90
    while waiting:
        assert time.monotonic() < deadline
        if "closed" in waiting:
            terminal.read()
        for name in sorted(waiting):
            metrics = folder / name / "metrics.csv"
            assert ends[name][0].poll() is None
            if metrics.exists() and metrics.read_text().count("\n") >= 3:
                ends[name][2]()
                waiting.remove(name)
        time.sleep(0.005)
    for name, (process, status, _) in ends.items():
        _, shown = process.communicate(timeout=60)
        assert process.returncode == status, shown
        if name != "closed":
            assert "Traceback" not in shown
            assert f"everything is saved in {name}" in shown
            assert f"serp plan-and-learn --resume {name}" in shown
        done = rows(folder / name, "metrics")
        assert 2 <= len(done) < 9
        assert done == rows(whole, "metrics")[: len(done)]
        assert (folder / name / "report.md").exists()
    installed(folder, "plan-and-learn", "--resume=closed")
    assert rows(folder / "closed", "metrics") == rows(whole, "metrics")
    assert rows(folder / "closed", "decisions") == rows(whole, "decisions")
