"""Forges checkpoints and resumes each: an error that says so, or a run that goes on.

    python tests/benchmarks/fuzz_checkpoints.py [--count 1000] [--first 0] [--tasks cliff soccer]

A process that dies, hangs or raises anything but a `SerpError` is told, with the seed that does it
again; the fuzzing goes on behind it. It exits with 1 where there was any.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.forging import begin


def fuzz(run: Path, first: int, count: int) -> tuple[Counter[str], list[str]]:
    """Forges from several seeds on; returns how often what came of it, and what went wrong."""
    ended: Counter[str] = Counter()
    wrong: list[str] = []
    seed = first
    while seed < first + count:
        done = subprocess.run(
            [sys.executable, "-m", "tests.forging", str(run), str(seed), str(first + count - seed)],
            capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
        ended.update(what.partition(":")[0] for _, what in lines[1::2])
        if done.returncode == 0:
            break
        if not lines:
            raise SystemExit(done.stderr)
        seed, what = lines[-1]
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        wrong.append(f"seed {seed}, {what}: exit status {done.returncode}, {last}")
        print(wrong[-1], flush=True)
        seed += 1
    return ended, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="forgeries, of all tasks together")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--tasks", nargs="+", default=["cliff", "soccer", "cartpole"])
    asked = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        for task in asked.tasks:
            begin(task, Path(folder) / task)
            count = asked.count // len(asked.tasks)
            ended, wrong = fuzz(Path(folder) / task, asked.first, count)
            failed = failed or bool(wrong)
            told = ", ".join(f"{number} {how}" for how, number in sorted(ended.items()))
            print(f"{task}: {told}, {len(wrong)} wrong", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
