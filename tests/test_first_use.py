"""What a newcomer does, in an empty folder, with the command as it is installed."""

import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

from serp.ui import main
from tests.serp.runs.runs import rows, without_pictures

# An untrained learner acts without help: short episodes, little to wait for.
QUICK = [
    "--domain=cartpole", "--seed=2", "--set=arbiter.rho=1", "--set=planner.depth=1",
    "--set=guide.strategy=mixture", "--set=learner.updates_per_step=0", "--episodes=150",
]  # fmt: skip


def serp(*arguments):
    """Run a command in this process."""
    with without_pictures(), pytest.raises(SystemExit) as end:
        main([*arguments, "--quiet"])
    assert end.value.code == 0


class Terminal:
    """A terminal that somebody reads, until it is closed."""

    def __init__(self):
        self.master, self.slave = pty.openpty()

    def enter(self):
        """Make it the terminal of the session that the calling process leads."""
        os.close(os.open(os.ttyname(self.slave), os.O_RDWR))

    def read(self):
        """Read what is there."""
        while select.select([self.master], [], [], 0)[0]:
            os.read(self.master, 65536)


@pytest.mark.skipif(os.name == "nt", reason="no such signals there")
def test_a_run_whose_terminal_is_closed_goes_on_as_if_nothing_had_been(tmp_path, monkeypatch):
    """`test_plan_and_learn` sends the other signals."""
    monkeypatch.chdir(tmp_path)
    long = [*QUICK, "--episodes=250"]  # it is not over when the terminal is closed
    terminal = Terminal()
    process = subprocess.Popen(
        [sys.executable, "-m", "serp", "plan-and-learn", *long, "--out=closed"],
        stdout=terminal.slave, stderr=terminal.slave, start_new_session=True,
        preexec_fn=terminal.enter,
    )  # fmt: skip
    os.close(terminal.slave)
    metrics, deadline = Path("closed", "metrics.csv"), time.monotonic() + 90
    while not metrics.exists() or metrics.read_text().count("\n") < 3:
        assert time.monotonic() < deadline and process.poll() is None
        terminal.read()
        time.sleep(0.005)
    os.close(terminal.master)
    # The signal of the terminal, or that of a write to it, whichever comes first.
    assert process.wait(timeout=60) in (129, 141)
    serp("plan-and-learn", *long, "--out=whole")
    done, whole = rows("closed", "metrics"), rows("whole", "metrics")
    assert 2 <= len(done) < 250
    assert done == whole[: len(done)]
    assert Path("closed", "summary.json").exists()
    serp("plan-and-learn", "--resume=closed")
    assert rows("closed", "metrics") == whole
    assert rows("closed", "decisions") == rows("whole", "decisions")
