"""Runs that somebody forged go on or are refused; nothing else ever happens."""

import json
import subprocess
import sys
from pathlib import Path

from tests import forging

SEEDS = ("0", "16")
ROOT = Path(__file__).parents[2]


def test_a_forged_checkpoint_is_refused_or_gone_on_with(tmp_path):
    """In a process of its own, which must neither die nor hang.

    `python -m tests.forging FOLDER 0 1000` does the same by the thousand.
    """
    done = subprocess.run(
        [sys.executable, "-m", "tests.forging", str(tmp_path / "run"), *SEEDS],
        capture_output=True, text=True, check=False, cwd=ROOT, timeout=10 * forging.SECONDS,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-300:]}\n{done.stderr[-3000:]}"
    ended = [json.loads(line)[1] for line in done.stdout.splitlines()[1::2]]
    assert len(ended) == int(SEEDS[1])
    assert {how.partition(":")[0] for how in ended} == {"refused", "went on"}
