"""What a newcomer does, in an empty folder, with the command as it is installed."""

from __future__ import annotations

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

from tests.serp.training.runs import rows

# An untrained learner acts without help: short episodes, little to wait for.
QUICK = [
    "--domain=cartpole", "--seed=2", "--set=arbiter.rho=1", "--set=planner.depth=1",
    "--set=guide.strategy=mixture", "--set=training.checkpoint_seconds=0",
]  # fmt: skip


def installed(folder: Path, *arguments: str) -> str:
    """Run a command in a folder, in a process of its own, as a user does."""
    done = subprocess.run(
        [sys.executable, "-m", "serp", *arguments],
        cwd=folder, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


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
