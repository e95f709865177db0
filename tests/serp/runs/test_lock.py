from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from serp.errors import RunError
from serp.runs.lock import RunLock

_HOLD = """
import sys, time
from pathlib import Path
from serp.runs.lock import RunLock
lock = RunLock(Path(sys.argv[1]))
print(flush=True)
time.sleep(60)
"""


def test_another_process_is_kept_out_until_it_dies(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", _HOLD, str(tmp_path)], stdout=subprocess.PIPE)
    with child:
        child.stdout.readline()
        with pytest.raises(RunError, match=rf"is being written by process {child.pid} on "):
            RunLock(tmp_path)
        child.send_signal(signal.SIGKILL)
        child.wait()
        RunLock(tmp_path).release()


def test_a_folder_that_is_gone_is_a_run_error(tmp_path):
    with pytest.raises(RunError, match=r"cannot write .*\.lock"):
        RunLock(tmp_path / "gone")
