"""What an engine costs: trials that sleep, of which one kills its worker, and many tiny ones.

    python -m tests.benchmarks.study_engines kill ENGINE [TRIALS [SECONDS]]
    python -m tests.benchmarks.study_engines tiny ENGINE [TRIALS]

`kill`: TRIALS (64) of SECONDS (10) over 4 workers; the worker of one of them is killed once. The
numbers of all trials are compared with those of the same trials in this process, which do not
sleep. `tiny`: TRIALS (1,000) of 20 env steps; says what a trial costs the driver, and what the
report costs.
"""

from __future__ import annotations

import functools
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from serp.runs.comparison.compare import compare
from serp.runs.rollout import training_seed
from serp.tasks.task import Task
from tests.serp.runs.comparison.contest import Walk, everything, walk

WORKERS = 4
STEPS = 20


class Sleeping(Walk):
    """Takes its time, and kills its process at the first step of seed 5, but only once."""

    def __init__(self, seconds: float, folder: Path, killing: bool) -> None:
        super().__init__()
        self.pause, self.folder = seconds / STEPS, folder
        self.killed = folder / "killed" if killing else None
        self.training, self.begun = False, time.monotonic()

    def close(self) -> None:
        if self.training:
            with (self.folder / "times").open("a") as file:
                file.write(f"{self.begun} {time.monotonic()}\n")
        super().close()

    def reset(self, *, seed: int | None = None, **options: Any) -> Any:
        self.training |= seed in TRAINING
        if seed == training_seed(5, 0) and self.killed is not None and not self.killed.exists():
            self.killed.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().reset(seed=seed, **options)

    def step(self, action: int) -> Any:
        time.sleep(self.pause if self.training else 0.0)
        return super().step(action)


TRAINING = {training_seed(seed, 0) for seed in range(1_000)}


def sleeping(folder: Path, seconds: float, *, killing: bool = False) -> Task:
    return walk(folder, functools.partial(Sleeping, seconds, folder, killing))


def timed(task: Task, out: Path, trials: int, **options: Any) -> float:
    """Compare, and return the seconds that it took."""
    begun = time.monotonic()
    compare(
        task, algorithms=["dqn"], seeds=trials, env_steps=STEPS, evaluate_every=STEPS,
        final_episodes=1, out=out, quiet=True, **options,
    )  # fmt: skip
    return time.monotonic() - begun


def kill(engine: str, trials: int = 64, seconds: float = 10.0) -> None:
    folder = Path(tempfile.mkdtemp())
    task = sleeping(folder, seconds, killing=True)
    begun = time.monotonic()
    took = timed(task, folder / "c", trials, jobs=WORKERS, engine=engine)
    lines = (folder / "times").read_text().splitlines()
    spans = np.array([line.split() for line in lines], dtype=float)
    busy, first, last = float(np.sum(np.diff(spans))), spans[:, 0].min(), spans[:, 1].max()
    timed(sleeping(folder, 0.0), folder / "here", trials, jobs=1)
    found = everything(folder / "c")
    print(f"{engine}: {trials} trials of {seconds} s over {WORKERS} workers: {took:.1f} s; the "
          f"first began after {first - begun:.1f} s; a trial took {busy / len(spans):.2f} s of a "
          f"worker; workers waited for {1 - busy / WORKERS / (last - first):.1%} of the time; "
          f"killed: {(folder / 'killed').exists()}; records {len(found)}, equal to local ones: "
          f"{found == everything(folder / 'here')}")  # fmt: skip


def tiny(engine: str, trials: int = 1_000) -> None:
    folder = Path(tempfile.mkdtemp())
    begun = time.process_time()
    took = timed(sleeping(folder, 0.0), folder / "c", trials, engine=engine)
    driver, begun = time.process_time() - begun, time.process_time()
    timed(sleeping(folder, 0.0), folder / "c", trials, engine=engine)
    report = time.process_time() - begun
    files = sum(file.stat().st_blocks * 512 for file in (folder / "c" / "trials").rglob("*"))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{engine}: {trials} trials of {STEPS} env steps: {took:.1f} s, in which the driver "
          f"computed {driver:.1f} s; checking and reporting what is complete: {report:.1f} s; "
          f"{files / 2**20:.0f} MiB of files, {memory:.0f} MiB of memory")  # fmt: skip


def main(what: str, engine: str, *numbers: str) -> None:
    {"kill": kill, "tiny": tiny}[what](engine, *map(int, numbers))  # type: ignore[operator]


if __name__ == "__main__":
    from tests.benchmarks.study_engines import main as importable  # not `__main__`

    importable(*sys.argv[1:])
