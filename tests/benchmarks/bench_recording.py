"""What recording every step costs a training: time and disk.

    python tests/benchmarks/bench_recording.py [--domain NAME] [--env-steps N] [--pairs N]

Trainings with and without `training.record` alternate. Printed are the ratio of their processor
times (median of the pairs), the share of a recorded training that passes inside the recorder, and
the bytes of a decision in the recording and in decisions.csv.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import serp
from serp.runs.recording import Recorder

spent = 0.0


def timed(method: Callable[..., Any]) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        global spent
        begin = process_time()
        try:
            return method(*arguments)
        finally:
            spent += process_time() - begin

    return call


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", default="soccer")
    parser.add_argument("--env-steps", type=int, default=2_000)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    def train(out: Path, record: bool) -> float:
        begin = process_time()
        serp.plan_and_learn(
            given.domain, settings={"training": {"record": record}}, seed=given.seed, out=out,
            env_steps=given.env_steps, quiet=True,
        )  # fmt: skip
        return process_time() - begin

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        train(root / "warm", True)  # compiles
        ratios = []
        for k in range(given.pairs):
            order = (True, False) if k % 2 else (False, True)
            times = {record: train(root / f"{k}-{record}", record) for record in order}
            ratios.append(times[True] / times[False])
        Recorder.append = timed(Recorder.append)  # type: ignore[method-assign]
        whole = train(root / "timed", True)
        run = root / "timed"
        steps = int(serp.load_run(run).metrics["env_steps"][-1])
        recorded = sum(file.stat().st_size for file in (run / "recording").iterdir())
        table = (run / "decisions.csv").stat().st_size
    print(f"ratio {np.median(ratios):.3f}: {', '.join(f'{ratio:.3f}' for ratio in ratios)}")
    print(f"inside the recorder {100 * spent / whole:.2f} % of {whole:.1f} s")
    each = [count / steps for count in (recorded, table)]
    print(f"{steps} steps: {each[0]:.0f} bytes recorded, {each[1]:.0f} in decisions.csv")
    print(f"20,000 decisions: {20_000 * sum(each) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
