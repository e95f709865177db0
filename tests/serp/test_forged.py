"""Runs that somebody forged go on or are refused; nothing else ever happens."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests import forging

SEEDS = (0, 16)
ROOT = Path(__file__).parents[2]


def test_a_forged_checkpoint_is_refused_or_gone_on_with(tmp_path: Path) -> None:
    """In a process of its own, which must neither die nor hang.

    `tests/benchmarks/fuzz_checkpoints.py` does the same by the thousand.
    """
    begun = "from pathlib import Path; from tests.forging import begin, main; import sys;"
    do = f"run = Path(sys.argv[1]); begin('cliff', run); main(run, {SEEDS[0]}, {SEEDS[1]})"
    done = subprocess.run(
        [sys.executable, "-c", f"{begun} {do}", str(tmp_path / "run")],
        capture_output=True, text=True, check=False, cwd=ROOT, timeout=10 * forging.SECONDS,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-300:]}\n{done.stderr[-3000:]}"
    ended = [json.loads(line)[1] for line in done.stdout.splitlines()[1::2]]
    assert len(ended) == SEEDS[1]
    assert {how.partition(":")[0] for how in ended} == {"refused", "went on"}
